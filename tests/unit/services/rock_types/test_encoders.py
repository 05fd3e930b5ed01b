# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values for ports of ROCK become the same poses and clouds again when they are read."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import LidarScan, Time, TransformWithCovariance
from services.corba.cdr import CdrReader, CdrWriter
from services.corba.typecodes import AnyReader, TypeCode, write_any
from services.rock_types.conversions import conversion_of
from services.rock_types.encoders import encoded
from services.rock_types.values import Source, stamp_ns

_STAMP_NS = 1_700_000_000_000_001_000
_DOUBLE = TypeCode("double")
_TIME = TypeCode("struct", "Time", "IDL:Time:1.0", (("microseconds", TypeCode("longlong")),))


def _vectors(size: int) -> TypeCode:
    data = TypeCode("array", element=_DOUBLE, length=size)
    return TypeCode("sequence", element=TypeCode("struct", f"V{size}", f"IDL:V{size}:1.0", (("data", data),)))


_POINTCLOUD = TypeCode(
    "struct", "Cloud", "IDL:C:1.0", (("time", _TIME), ("points", _vectors(3)), ("colors", _vectors(4)))
)


@pytest.mark.parametrize("count", [0, 5])
def test_a_cloud_is_equal_after_its_way_over_corba(count: int, rng: np.random.Generator) -> None:
    points_m = rng.normal(size=(count, 3)).astype(np.float32)
    scan = LidarScan.from_arrays(
        points_m, np.zeros(count, np.uint32), frame="mana/lidar", t0_ns=_STAMP_NS, t1_ns=_STAMP_NS
    )
    writer = CdrWriter()
    write_any(writer, _POINTCLOUD, encoded(scan, "/base/samples/Pointcloud", str, _STAMP_NS))
    _, value = AnyReader().read(CdrReader(bytes(writer.data), True))
    assert stamp_ns(value["time"]) == _STAMP_NS
    conversion = conversion_of("/base/samples/Pointcloud", tuple(value))
    cloud, frame, _ = conversion.convert(value, Source("lidar", _STAMP_NS, sensor="mana/lidar"))
    assert frame == "mana/lidar"
    np.testing.assert_array_equal(cloud.points_m, points_m)


@pytest.mark.parametrize("has_covariance", [True, False])
def test_a_pose_is_equal_when_it_is_read_again(has_covariance: bool) -> None:
    T = se3.transform(se3.exp_so3([0.1, -0.4, 0.7]), [1.0, 2.0, 3.0])
    covariance = np.diag([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]) if has_covariance else None
    pose = TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance), parent="mana/odom", child="mana/base", stamp_ns=_STAMP_NS
    )
    names = {"mana/odom": "map", "mana/base": "body"}
    value = encoded(pose, "/base/samples/RigidBodyState_m", names.__getitem__, _STAMP_NS)
    conversion = conversion_of("/base/samples/RigidBodyState", tuple(value))
    frames = {name: frame for frame, name in names.items()}
    again, parent, child = conversion.convert(value, Source("task", _STAMP_NS, frames=frames))
    assert (parent, child, again.metadata.parent_time) == ("mana/odom", "mana/base", Time.from_ns(_STAMP_NS))
    np.testing.assert_allclose(again.data.translation, pose.data.translation)
    np.testing.assert_allclose(again.data.orientation, pose.data.orientation)
    for block in (np.s_[:3, :3], np.s_[3:, 3:]):  # ROCK has no covariance of position and orientation
        np.testing.assert_allclose(again.data.cov[block], pose.data.cov[block], atol=1e-12)
    assert np.isnan(value["velocity"]["data"]).all()
    assert np.isnan(value["cov_angular_velocity"]["data"]).all()


def test_a_value_without_a_type_in_rock_is_refused() -> None:
    with pytest.raises(InputError, match=r"a Time as /base/Time: expected TransformWithCovariance as"):
        encoded(Time(1), "/base/Time", str, _STAMP_NS)
