# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.types import LaserRangeErrors, LaserScan, RigidBodyState
from cdff_core.dfns.laser_filter.box_filter import BoxFilter
from cdff_core.dfns.laser_filter.interface import LaserFilterInputs

ROTATION_180_DEG_ABOUT_Z = [0.0, 0.0, 1.0, 0.0]
ROTATION_90_DEG_ABOUT_Z = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
NO_ROTATION = [0.0, 0.0, 0.0, 1.0]


def _scan(ranges_m: ArrayLike, start_angle: float = 0.0) -> LaserScan:
    """Return a scan of four beams: forward, left, back and right of the laser."""
    ranges = np.round(np.asarray(ranges_m) * 1000).astype(np.int32)
    return LaserScan(
        ranges=ranges, remission=np.ones(len(ranges)), start_angle=start_angle, angular_resolution=np.pi / 2
    )


def _pose(pos: ArrayLike = (0, 0, 0), orient: ArrayLike = NO_ROTATION) -> RigidBodyState:
    return RigidBodyState(
        source_frame="laser",
        target_frame="body",
        pos=np.asarray(pos, float),
        orient=np.asarray(orient, float),
    )


def _removed(scan: LaserScan, pose: RigidBodyState, **config: object) -> list[int]:
    dfn = BoxFilter()
    dfn.configure(config)
    filtered = dfn.process(LaserFilterInputs(scan_samples=scan, laser_2_body_tf=pose)).filtered_scans
    removed = np.flatnonzero(filtered.ranges != scan.ranges)
    retained = np.delete(np.arange(len(scan.ranges)), removed)
    assert (filtered.ranges[removed] == LaserRangeErrors.OTHER_RANGE_ERRORS).all()
    np.testing.assert_array_equal(filtered.ranges[retained], scan.ranges[retained])
    return removed.tolist()


@pytest.mark.req("CDFF-CORE-040")
def test_points_inside_the_box_are_removed() -> None:
    assert _removed(_scan([0.3, 2.0, 0.4, 3.0]), _pose()) == [0, 2]


def test_points_outside_the_box_are_removed_on_request() -> None:
    assert _removed(_scan([0.3, 2.0, 0.4, 3.0]), _pose(), remove="outside") == [1, 3]


def test_the_box_is_fixed_to_the_body_and_not_to_the_laser() -> None:
    """The laser is 1 m ahead of the body's origin: a point 1 m behind the laser is inside the box."""
    assert _removed(_scan([1.0, 1.0, 1.0, 1.0]), _pose(pos=[1, 0, 0])) == [2]


@pytest.mark.req("CDFF-CORE-060")
def test_the_transform_is_the_pose_of_the_laser_in_the_body() -> None:
    """A laser rotated by +90° points its first beam to the left of the body: it is T_body_laser."""
    box = {"min_corner_m": (-0.1, 0.9, -0.1), "max_corner_m": (0.1, 1.1, 0.1)}
    assert _removed(_scan([1.0, 1.0, 1.0, 1.0]), _pose(orient=ROTATION_90_DEG_ABOUT_Z), **box) == [0]


def test_the_rotation_is_applied_before_the_translation() -> None:
    box = {"min_corner_m": (0.9, -0.1, -0.1), "max_corner_m": (1.1, 0.1, 0.1)}
    assert _removed(
        _scan([1.0, 1.0, 1.0, 1.0]), _pose(pos=[2, 0, 0], orient=ROTATION_180_DEG_ABOUT_Z), **box
    ) == [0]


def test_the_height_of_the_laser_is_taken_into_account() -> None:
    assert _removed(_scan([0.3, 0.3, 0.3, 0.3]), _pose(pos=[0, 0, 0.6])) == []


def test_the_box_includes_its_faces() -> None:
    assert _removed(_scan([0.5, 0.501, 2, 2]), _pose()) == [0]


def test_error_codes_are_unchanged_inside_and_outside_the_box() -> None:
    scan = _scan([0.002, 2.0, 0.004, 0.3])
    assert _removed(scan, _pose()) == [3]
    assert _removed(scan, _pose(), remove="outside") == [1]


@pytest.mark.parametrize(
    "pose",
    [
        _pose(pos=[np.nan, 0, 0]),
        _pose(orient=[0, 0, 0, 0]),
        _pose(orient=[0, 0, 0, 2]),
        _pose(orient=[np.nan] * 4),
    ],
)
def test_an_invalid_transform_is_refused(pose: RigidBodyState) -> None:
    with pytest.raises(InputError, match="laser_2_body_tf"):
        _removed(_scan([1, 1, 1, 1]), pose)


def test_a_scan_with_an_unknown_start_angle_is_refused() -> None:
    with pytest.raises(InputError, match="start_angle nan"):
        _removed(_scan([1, 1, 1, 1], start_angle=np.nan), _pose())


@pytest.mark.parametrize(
    "config", [{"min_corner_m": (1, 0, 0), "max_corner_m": (0, 1, 1)}, {"remove": "all"}, {"box": 1}]
)
def test_an_invalid_configuration_is_refused(config: dict[str, object]) -> None:
    with pytest.raises(ConfigurationError, match="BoxFilter"):
        BoxFilter().configure(config)
