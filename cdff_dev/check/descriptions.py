# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Descriptions against the code they describe: ports, parameters, implementations, template fields, tests."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from cdff_common.errors import CdffError
from cdff_common.interfaces.description import ARRAY_TYPE, DfnDescription, DfpcDescription, Port
from cdff_common.interfaces.dfn import Dfn, StrictModel
from cdff_common.interfaces.dfpc import Dfpc
from cdff_common.interfaces.registry import Registry

#: Value types of outputs of operations and store items that are no class of ``cdff_common.types``.
PLAIN_TYPES = frozenset({"void", "float", "int", "string", "bool"})


def faults(root: Path, registry: Registry) -> list[str]:
    """Everything that is wrong, one line each; nothing where all descriptions fit."""
    wrong = [f"{name}: did not load: {reason}" for name, reason in sorted(registry.failures.items())]
    for found in registry.dfns.values():
        wrong += dfn_faults(root, found.description, registry)
    for found in registry.dfpcs.values():
        wrong += dfpc_faults(root, found.description, registry)
    return wrong


def dfn_faults(root: Path, dfn: DfnDescription, registry: Registry) -> list[str]:
    """What is wrong with one DFN."""
    wrong = [f"template field {n!r} is empty" for n in ("doc", "output_ports", "cost", "tests") if not getattr(dfn, n)]
    # A DFN may have no parameter, no dependency and nothing to diagnose, but then its file says so.
    stated = ("parameters", "dependencies", "diagnostics")
    wrong += [f"template field {n!r} is missing" for n in stated if n not in dfn.model_fields_set]
    wrong += _type_faults([*dfn.input_ports, *dfn.output_ports])
    wrong += _test_faults(root, dfn.tests)
    wrong += [f"cost of {name!r}, which is no implementation" for name in set(dfn.cost) - set(dfn.implementations)]
    strange = set(dfn.implementation_aliases.values()) - set(dfn.implementations)
    wrong += [f"alias of {name!r}, which is no implementation" for name in strange]
    configured: dict[str, set[str]] = {}
    for implementation in dfn.implementations:
        try:
            node = registry.make_dfn(dfn.folder, implementation)
            node.configure()
        except (CdffError, ImportError, AttributeError, TypeError) as error:
            wrong.append(f"implementation {implementation}: {type(error).__name__}: {error}")
            continue
        configured[implementation] = set(type(node).Config.model_fields)
    wrong += _parameter_faults(dfn, configured)
    return [f"DFN {dfn.folder}: {fault}" for fault in wrong]


def dfpc_faults(root: Path, dfpc: DfpcDescription, registry: Registry) -> list[str]:
    """What is wrong with one DFPC."""
    wrong = [
        f"template field {n!r} is empty"
        for n in ("doc", "control", "tests", "cost", "accuracy")
        if not getattr(dfpc, n)
    ]
    wrong += _type_faults([*dfpc.input_ports, *dfpc.output_ports])
    wrong += [f"item {m.item}: no type {m.type!r}" for m in dfpc.product_management if not _is_type(m.type)]
    wrong += [
        f"operation {o.name}: no type {o.output_type!r}"
        for o in dfpc.operations
        if o.output_type not in PLAIN_TYPES and not _is_type(o.output_type)
    ]
    wrong += _test_faults(root, dfpc.tests)
    for variant in dfpc.implementations:
        for slot in variant.dfns:
            try:
                registry.make_dfn(slot.name, slot.implementation).configure(dict(slot.parameters))
            except (CdffError, ImportError, AttributeError, TypeError) as error:
                wrong.append(f"{variant.name}.{slot.dfn_id}: {type(error).__name__}: {error}")
        try:
            registry.make_dfpc(dfpc.folder).configure(implementation=variant.name)
        except (CdffError, ImportError, AttributeError, TypeError) as error:
            wrong.append(f"implementation {variant.name}: {type(error).__name__}: {error}")
    return [f"DFPC {dfpc.folder}: {fault}" for fault in wrong]


def config_of(kind: str, folder: str, implementation: str | None, registry: Registry) -> type[StrictModel]:
    """Configuration model of a DFN's implementation or of a DFPC."""
    node: Dfn[Any, Any, Any] | Dfpc
    node = registry.make_dfn(folder, implementation) if kind == "dfn" else registry.make_dfpc(folder)
    return type(node).Config


def _parameter_faults(dfn: DfnDescription, configured: dict[str, set[str]]) -> list[str]:
    """Parameters of the description that no Config has, and fields of a Config that the description lacks."""
    wrong: list[str] = []
    for implementation, fields in configured.items():
        described = {p.name for p in dfn.parameters if not p.implementations or implementation in p.implementations}
        wrong += [f"parameter {n!r} of {implementation} is not described" for n in sorted(fields - described)]
        wrong += [f"{implementation} has no parameter {n!r}" for n in sorted(described - fields)]
    for parameter in dfn.parameters:
        unknown = set(parameter.implementations) - set(dfn.implementations)
        wrong += [f"parameter {parameter.name!r}: no implementation {name!r}" for name in sorted(unknown)]
    return wrong


def _type_faults(ports: list[Any]) -> list[str]:
    wrong = [f"port {p.name}: no type {p.type_name!r}" for p in ports if not _fits(p)]
    return wrong + [f"port {p.name}: no doc" for p in ports if not p.doc]


def _fits(port: Port) -> bool:
    return ARRAY_TYPE.match(port.type) is not None or _is_type(port.type_name)


def _is_type(name: str) -> bool:
    types = importlib.import_module("cdff_common.types")
    return any(getattr(getattr(types, n), "ASN1_NAME", None) == name or n == name for n in types.__all__)


def _test_faults(root: Path, tests: tuple[str, ...]) -> list[str]:
    return [f"test {t!r} does not exist" for t in tests if not (root / t.split("::")[0]).is_file()]
