# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tests that run for every DFN and DFPC of the registry, so that a new one needs no new test."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus.message import pack, unpack
from cdff_common.errors import ConfigurationError, InputError
from cdff_common.interfaces.array_ports import ARRAY_TYPE
from cdff_common.interfaces.description import Port, read_dfn_description
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import Dfpc
from cdff_common.interfaces.registry import Registry
from cdff_dev.check import descriptions

ROOT = Path(__file__).resolve().parents[2]
REGISTRY = Registry.default()
IMPLEMENTATIONS = [(name, i) for name, dfn in REGISTRY.dfns.items() for i in dfn.description.implementations]


@pytest.mark.req("CDFF-CORE-030")
def test_every_description_in_the_tree_loads() -> None:
    assert REGISTRY.failures == {}
    folders = {
        p.parent.name for kind in ("dfn", "dfpc") for p in (ROOT / "cdff_core").glob(f"{kind}s/*/{kind}.yaml")
    }
    assert folders <= REGISTRY.dfns.keys() | REGISTRY.dfpcs.keys()


@pytest.mark.req("CDFF-CORE-020", "CDFF-CORE-021", "CDFF-CORE-022")
@pytest.mark.parametrize("name", sorted(REGISTRY.dfns))
def test_every_dfn_matches_its_description(name: str) -> None:
    assert descriptions.dfn_faults(ROOT, REGISTRY.dfn(name), REGISTRY) == []


@pytest.mark.req("CDFF-SUP-010", "CDFF-SUP-011")
@pytest.mark.parametrize("name", sorted(REGISTRY.dfpcs))
def test_every_dfpc_matches_its_description(name: str) -> None:
    assert descriptions.dfpc_faults(ROOT, REGISTRY.dfpc(name), REGISTRY) == []


@pytest.mark.req("CDFF-CORE-010")
@pytest.mark.parametrize(("name", "implementation"), IMPLEMENTATIONS)
def test_a_dfn_has_configure_and_process_as_its_only_methods(name: str, implementation: str) -> None:
    node = REGISTRY.make_dfn(name, implementation)
    assert isinstance(node, Dfn)
    public = {n for n in dir(type(node)) if not n.startswith("_")}
    # configure() calls setup(); callers need no other method.
    operations = {n for n in public if callable(getattr(type(node), n)) and n != "Config"}
    assert operations == {"configure", "process", "setup"}


@pytest.mark.req("CDFF-CORE-011")
@pytest.mark.parametrize(("name", "implementation"), IMPLEMENTATIONS)
def test_unknown_parameter_of_a_dfn_is_refused_by_name(name: str, implementation: str) -> None:
    with pytest.raises(ConfigurationError, match="no_such_parameter"):
        REGISTRY.make_dfn(name, implementation).configure({"no_such_parameter": 1})


@pytest.mark.parametrize(("name", "implementation"), IMPLEMENTATIONS)
def test_configuration_of_a_dfn_is_frozen_and_described_with_bounds(name: str, implementation: str) -> None:
    config: Any = type(REGISTRY.make_dfn(name, implementation)).Config
    assert config.model_config["frozen"]
    assert config.model_config["extra"] == "forbid"
    for field, schema in config.model_json_schema().get("properties", {}).items():
        if schema.get("type") in ("integer", "number"):
            bounds = {"minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "enum"}
            assert bounds & schema.keys(), f"{name}/{implementation}.{field} has no bound"


def fitting_array(port: Port) -> np.ndarray[Any, Any]:
    """Return an array of ones that fits the type of a port; free sizes are 2."""
    match = ARRAY_TYPE.match(port.type)
    assert match is not None
    shape = [int(size) if size.isdigit() else 2 for size in match["shape"].split(",")]
    return np.ones(shape, match["dtype"])


@pytest.mark.parametrize("name", sorted(REGISTRY.dfns))
def test_a_wrong_shape_or_none_at_an_array_port_is_refused_with_the_name_of_the_port(name: str) -> None:
    ports = REGISTRY.dfn(name).input_ports
    inputs = REGISTRY.dfns[name].load("interface", "Inputs")
    arrays = {p.attribute: fitting_array(p) for p in ports if ARRAY_TYPE.match(p.type)}
    others = {p.attribute: None for p in ports if p.attribute not in arrays}
    for port in ports:
        if port.attribute not in arrays:
            continue
        with pytest.raises(InputError, match=rf"^{port.attribute} \(\): expected {re.escape(port.type)}"):
            inputs(**others | arrays | {port.attribute: np.array(1.0)})
        if not port.optional:
            with pytest.raises(
                InputError, match=rf"^{port.attribute}: None, expected {re.escape(port.type)}"
            ):
                inputs(**others | arrays | {port.attribute: None})


@pytest.mark.parametrize("name", sorted(REGISTRY.dfpcs))
def test_unknown_parameter_of_a_dfpc_is_refused_by_name(name: str) -> None:
    with pytest.raises(ConfigurationError, match="no_such_parameter"):
        REGISTRY.make_dfpc(name).configure({"no_such_parameter": 1})


@pytest.mark.parametrize("name", sorted(REGISTRY.dfpcs))
def test_dfpc_handles_every_input_port_and_operation_of_its_description(name: str) -> None:
    dfpc = REGISTRY.make_dfpc(name)
    assert isinstance(dfpc, Dfpc)
    description = REGISTRY.dfpc(name)
    for port in description.input_ports:
        assert callable(getattr(dfpc, f"on_{port.attribute}"))
    for operation in description.operations:
        assert callable(getattr(dfpc, operation.name))


@pytest.mark.parametrize("name", sorted(REGISTRY.dfpcs))
def test_the_stated_parameters_of_a_dfpc_configure_it_to_the_same_values(name: str) -> None:
    dfpc, again = REGISTRY.make_dfpc(name), REGISTRY.make_dfpc(name)
    dfpc.configure()
    again.configure(unpack(pack(dfpc.config.model_dump(mode="json"))))
    assert again.config_hash == dfpc.config_hash


@pytest.mark.req("CDFF-SUP-013")
@pytest.mark.parametrize("name", sorted(REGISTRY.dfpcs))
def test_dfpc_stores_the_items_that_its_description_lists(name: str) -> None:
    dfpc = REGISTRY.make_dfpc(name)
    dfpc.configure()
    assert set(dfpc.store.items) == {m.item for m in REGISTRY.dfpc(name).product_management}


@pytest.mark.req("CDFF-CORE-041")
def test_the_description_in_figure_3_of_the_paper_loads_and_that_of_laser_filter_extends_it() -> None:
    fig3 = read_dfn_description(ROOT / "tests" / "data" / "fig3_laser_filter.yaml")
    shipped = REGISTRY.dfn("LaserFilter")
    for field in fig3.model_fields_set:
        assert getattr(shipped, field) == getattr(fig3, field)
