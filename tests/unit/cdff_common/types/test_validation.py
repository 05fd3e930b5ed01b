# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Validation of message fields, and their canonical form."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from cdff_common import types
from cdff_common.errors import InputError


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: types.Pose(pos=[1, 2]), r"Pose.pos: shape \(2,\), expected \(3\)"),
        (lambda: types.Pose(pos=np.zeros((3, 1))), "Pose.pos: shape"),
        (lambda: types.Pose(pos=["a", "b", "c"]), "Pose.pos=.*expected real numbers"),
        (lambda: types.Pose(pos=np.zeros(3, complex)), "Pose.pos.*complex"),
        (lambda: types.Time(2**63), "Time.microseconds=9223372036854775808: expected"),
        (lambda: types.Time(True), "Time.microseconds=True: expected an integer"),
        (lambda: types.Time(1.0), "Time.microseconds=1.0: expected an integer"),
        (lambda: types.Temperature("1"), "Temperature.kelvin='1': expected a real number"),
        (lambda: types.Temperature(10**400), "Temperature.kelvin"),
        (lambda: types.InvalidName("x" * 257), "InvalidName.name_string.*257 bytes.*at most 256"),
        (lambda: types.InvalidName(b"x"), "InvalidName.name_string=b'x': expected text"),
        (lambda: types.InvalidName("\ud800"), "InvalidName.name_string.*UTF-8"),
        (lambda: types.Frame(metadata=types.Time()), "Frame.metadata: .* is a Time, expected FrameMetadataT"),
        (lambda: types.FrameMetadataT(mode=99), "FrameMetadataT.mode=99: expected one of MODE_UNDEF=0"),
        (lambda: types.FrameMetadataT(mode="mode-GRAY"), "FrameMetadataT.mode='mode-GRAY'"),
        (
            lambda: types.JointTrajectory([types.JointState()] * 61),
            "JointTrajectory.items: 61 elements, expected 1",
        ),
        (lambda: types.PosesSequence([types.Pose(), 3]), r"PosesSequence.items\[1\]: 3 is a int"),
        (lambda: types.JointTrajectory(()), "JointTrajectory.items: 0 elements, expected 1..60"),
        (lambda: types.LaserScan(ranges=[2**31]), "LaserScan.ranges: values 2147483648"),
        (lambda: types.LaserScan(ranges=[1.5]), "LaserScan.ranges.*expected integers"),
        (lambda: types.SonarBeam(beam=[256]), "SonarBeam.beam: values 256..256, expected 0..255"),
        (
            lambda: types.PointCloudData(points=np.broadcast_to(0.0, (2**24 + 1, 3))),
            r"shape \(16777217, 3\), expected",
        ),
        (
            lambda: types.PointCloudData(points=np.zeros((4, 3)), colors=np.zeros((3, 3))),
            "colors: 3 rows, expected 4",
        ),
        (
            lambda: types.Array3D(data=np.zeros(4)),
            "Array3D.data.*expected bytes or a uint8 array|Array3D.data.*dtype",
        ),
        (
            lambda: types.TransformWithCovarianceMetadata(data_estimated=[1] * 7),
            "data_estimated.*expected booleans",
        ),
        (
            lambda: types.VisualPointFeature3DPoint("nowhere"),
            "kind='nowhere': expected one of position, reference",
        ),
    ],
)
def test_a_wrong_value_is_refused_with_its_path(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


def test_arrays_are_converted_to_contiguous_read_only_float64_and_copied_only_if_necessary() -> None:
    points = np.arange(12.0).reshape(4, 3)
    data = types.PointCloudData(points)
    assert np.shares_memory(data.points, points)
    assert points.flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        data.points[0, 0] = 1.0
    converted = types.PointCloudData(np.asfortranarray(points).astype(np.float32)).points
    assert converted.dtype == np.float64
    assert converted.flags.c_contiguous
    assert not converted.flags.writeable


def test_octets_are_aligned_for_any_source_view() -> None:
    raw = np.zeros(17, np.uint8)
    assert types.Array3D(data=raw[1:]).data.ctypes.data % 8 == 0


def test_empty_lists_have_the_shape_of_their_type() -> None:
    assert types.PointCloudData([]).points.shape == (0, 3)
    assert types.MatrixXd([]).values.shape == (0, 0)


def test_trailing_nuls_of_text_are_dropped() -> None:
    assert types.InvalidName("LocalTerrainFrame\0").name_string == "LocalTerrainFrame"


def test_equality_is_by_value_and_nan_equals_nan() -> None:
    assert types.TransformWithCovariance() == types.TransformWithCovariance()
    assert types.Pose([1, 2, 3]) != types.Pose([1, 2, 4])
    assert types.Pose() != types.Time()
    assert types.Temperature(float("nan")) == types.Temperature(float("nan"))
    with pytest.raises(TypeError, match="unhashable"):
        hash(types.Pose())


def test_the_repr_of_a_message_is_short() -> None:
    cloud = types.Pointcloud.from_points(np.zeros((1000, 3)), frame="a", stamp_ns=0)
    assert "points=<float64 (1000, 3) 0..0>" in repr(cloud)
    assert len(repr(cloud)) < 3000


def test_the_types_load_without_the_codecs_and_other_heavy_modules() -> None:
    heavy = ["asn1tools", "numba", "msgpack", "scipy"]
    code = f"import sys, cdff_common.types; print([m for m in {heavy} if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
