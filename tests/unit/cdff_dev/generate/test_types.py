# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ASN.1 modules are read for the generation of Python classes: names, shapes, bounds and comments."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.types.schema import (
    Alias,
    Array,
    Choice,
    Enumeration,
    Integer,
    ListOf,
    OctetString,
    Real,
    Struct,
    Text,
)
from cdff_dev.generate.asn1_model import ModelReader, class_name, snake_case

_SOURCE = """
M DEFINITIONS AUTOMATIC TAGS ::= BEGIN
maxLen INTEGER ::= 70000
t-Version INTEGER ::= 3
T-String ::= OCTET STRING (SIZE(0..256))
T-Double ::= REAL (-1.0..1.0)
Float32x3-Array ::= OCTET STRING (SIZE(0..1200))
Point ::= SEQUENCE (SIZE(3)) OF T-Double
Row ::= SEQUENCE (SIZE(0..5)) OF T-Double
Colour ::= ENUMERATED {blue(2), dark-red(0)}
-- Measured thing.
-- In two lines.
Thing-data-t ::= SEQUENCE {
    msgVersion INTEGER (0..255),
    name       T-String,          -- of the thing
    points     SEQUENCE (SIZE(0..maxLen)) OF Point,  -- m
    rows       SEQUENCE (SIZE(1..2)) OF Row,
    colour     Colour,
    raw        Float32x3-Array,
    either     CHOICE {a Point, b Colour}
}
Things ::= SEQUENCE (SIZE(0..9)) OF Thing-data-t
END
"""


@pytest.fixture
def model(tmp_path: Path) -> ModelReader:
    (tmp_path / "thing.asn").write_text(_SOURCE)
    return ModelReader([tmp_path / "thing.asn"])


@pytest.mark.parametrize(
    ("asn1", "python"),
    [
        ("Frame-metadata-t", "FrameMetadataT"),
        ("PointCloud-Data", "PointCloudData"),
        ("UNIT-AXIS", "UnitAxis"),
        ("IMUSensors", "IMUSensors"),
        ("Array3D-depth-t", "Array3DDepthT"),
    ],
)
def test_class_names_are_the_asn1_names_without_dashes(asn1: str, python: str) -> None:
    assert class_name(asn1) == python


@pytest.mark.parametrize(
    ("asn1", "python"),
    [
        ("frameId", "frame_id"),
        ("cov-position", "cov_position"),
        ("usecPerSec", "usec_per_sec"),
        ("rows", "rows"),
        ("pose-robotFrame-sensorFrame", "pose_robot_frame_sensor_frame"),
    ],
)
def test_attributes_are_snake_case(asn1: str, python: str) -> None:
    assert snake_case(asn1) == python


def test_fields_become_nodes_with_their_bounds(model: ModelReader) -> None:
    thing_model = model.types["Thing-data-t"]
    assert isinstance(thing_model.node, Struct)
    nodes = {f.attribute: f.node for f in thing_model.node.fields}
    assert nodes["msg_version"] == Integer(0, 255)
    assert nodes["name"] == Text(256)
    assert nodes["points"] == Array(Real(), ((0, 70000), (3, 3)), ("Point", "T-Double"))
    assert nodes["rows"] == ListOf(Array(Real(), ((0, 5),), ("T-Double",)), 1, 2, "Row")
    assert nodes["colour"] == Enumeration("Colour", (("dark-red", 0), ("blue", 2)))
    assert nodes["raw"] == OctetString(1200, "<f4", 3)
    either = nodes["either"]
    assert isinstance(either, Choice)
    assert [f.attribute for f in either.alternatives] == ["a", "b"]
    things = model.types["Things"].node
    assert isinstance(things, Alias)
    assert things.attribute == "items"


def test_comments_and_versions_are_kept(model: ModelReader) -> None:
    thing_model = model.types["Thing-data-t"]
    assert thing_model.comment == "Measured thing. In two lines."
    assert thing_model.field_comments == {"name": "of the thing", "points": "m"}
    assert thing_model.version == 3


def test_a_type_follows_the_types_that_it_refers_to(model: ModelReader) -> None:
    names = list(model.types)
    assert names.index("Colour") < names.index("Thing-data-t") < names.index("Things")


def test_a_name_declared_twice_is_refused(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / f"{name}.asn").write_text(
            f"M-{name} DEFINITIONS ::= BEGIN\nT ::= SEQUENCE {{x BOOLEAN}}\nEND\n"
        )
    with pytest.raises(ValueError, match=r"b\.asn: type T is declared twice"):
        ModelReader(sorted(tmp_path.glob("*.asn")))
