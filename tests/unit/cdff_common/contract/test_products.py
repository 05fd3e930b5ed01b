# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Product types of the contract and of DFPCs."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cdff_common.contract.products import (
    CONTRACT_PRODUCTS,
    product_of_sample,
    product_of_suffix,
    product_type,
    product_types,
    with_compounds,
)
from cdff_common.errors import InputError
from cdff_common.interfaces.description import OutputPort
from cdff_common.interfaces.registry import Registry
from cdff_dev.check.descriptions import dfpc_faults


def compound(**products: str) -> Any:
    """Return a description with an output port for each ``product=type``."""
    ports = [
        OutputPort(name=f"p_{name}", type=type_name, product=name) for name, type_name in products.items()
    ]
    return SimpleNamespace(output_ports=tuple(ports))


def test_a_compound_adds_a_product_type() -> None:
    product = with_compounds([compound(planned_path="PoseTrajectory")])["planned_path"]
    assert (product.type_name, product.title, product.is_requestable) == (
        "PoseTrajectory",
        "Planned path",
        True,
    )
    assert product.formats[-3:] == ("tum", "npz", "geojson")


def test_a_compound_defines_the_type_of_a_contract_product_without_type() -> None:
    assert CONTRACT_PRODUCTS["mesh"].type_name is None
    assert with_compounds([compound(mesh="TriangleMesh")])["mesh"].type_name == "TriangleMesh"


def test_a_compound_cannot_change_the_type_of_a_contract_product() -> None:
    assert with_compounds([compound(dem="Pointcloud")])["dem"].type_name == "ElevationMap"


def test_every_product_of_every_compound_has_the_type_of_its_port() -> None:
    for dfpc in Registry.default().dfpcs.values():
        for port in dfpc.description.output_ports:
            if port.product is not None:
                assert product_type(port.product).type_name == port.type_name


def test_a_port_type_that_the_dpm_would_refuse_is_reported() -> None:
    registry = Registry.default()
    description = registry.dfpc("feature_matching")
    port = description.output_ports[0].model_copy(update={"product": "dem"})
    wrong = description.model_copy(update={"output_ports": (port,), "implementations": ()})
    faults = dfpc_faults(Path(), wrong, registry)
    assert any("a dem is stored as ElevationMap" in fault for fault in faults)


def test_an_unknown_product_type_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"type='painting': expected one of pose, .*landmarks"):
        product_type("painting")
    assert "painting" not in product_types()


@pytest.mark.parametrize(
    ("suffix", "product"),
    [
        ("ply", "pointcloud"),
        ("bin", "pointcloud"),
        ("laz", "pointcloud"),
        ("tif", "dem"),
        ("json", "pose"),
        ("tum", "trajectory"),
        ("g2o", "pose_graph"),
        ("pgm", "image"),
        ("xyz", None),
    ],
)
def test_a_file_suffix_selects_a_product(suffix: str, product: str | None) -> None:
    assert product_of_suffix(suffix) == product


def test_each_sample_type_is_recorded_as_a_product_type() -> None:
    assert product_of_sample("IMUSensors") == "imu_span"
    assert product_of_sample("Joints") == "sample"
