# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values of products in words and units."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import GridGeometry
from cdff_common.types import (
    ElevationMap,
    Frame,
    Pointcloud,
    PoseTrajectory,
    Time,
    TransformWithCovariance,
)
from cdff_common.value_text import value_lines


def pose(covariance: np.ndarray | None) -> TransformWithCovariance:
    T = se3.transform(se3.exp_so3([0.0, 0.0, np.radians(90.0)]), [1.5, -2.0, 0.25])
    return TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance), parent="site", child="mana/base", stamp_ns=1_000_000_000
    )


def test_a_pose_has_metres_and_degrees() -> None:
    sigma = np.array([0.1, 0.2, 0.3, *np.radians([1.0, 2.0, 3.0])])
    assert value_lines(pose(np.diag(sigma**2))) == [
        "mana/base in site at 1970-01-01T00:00:01.000000Z",
        "position: x 1.500, y -2.000, z 0.250 m",
        "orientation: roll 0.00, pitch 0.00, yaw 90.00 degrees",
        "standard deviations: 0.1, 0.2, 0.3 m; 1, 2, 3 degrees about x, y, z",
    ]
    assert value_lines(pose(None))[-1] == "standard deviations: unknown"


def test_a_trajectory_has_path_and_end() -> None:
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, 0, 3] = [0.0, 3.0, 1.0]
    stamps_ns = np.array([0, 1, 2]) * 10**9
    value = PoseTrajectory.from_arrays(stamps_ns, T, None, parent="a", child="b")
    assert value_lines(value) == [
        "3 poses, path 5.00 m in 2.0 s from 1970-01-01T00:00:00.000000Z",
        "end: x 1.000, y 0.000, z 0.000 m",
    ]


def test_a_map_has_extent_resolution_and_share_of_known_cells() -> None:
    geometry = GridGeometry("site", 0.5, 10.0, 4.0, 2, 4)
    heights = np.array([[1.0, 2.0, np.nan, np.nan], [3.0, -4.0, 0.0, np.nan]], np.float32)
    value = ElevationMap.from_layers(geometry, {"mean": heights}, t0_ns=0, t1_ns=0)
    assert value_lines(value) == [
        "4 x 2 cells of 0.5 m in site: 2 x 1 m from x 10, y 3",
        "layers: mean",
        "mean: 62 % of the cells known, -4 to 3 m",
    ]


def test_a_cloud_ignores_points_that_are_not_finite() -> None:
    value = Pointcloud.from_points([[0.0, 1.0, 2.0], [3.0, 1.0, -2.0], [np.nan] * 3], frame="f", stamp_ns=0)
    assert value_lines(value) == ["3 points, x 0.00 to 3.00, y 1.00 to 1.00, z -2.00 to 2.00 m"]


def test_an_image_has_its_size_and_other_types_their_name() -> None:
    assert value_lines(Frame.from_image(np.zeros((4, 6, 3), np.uint8), stamp_ns=0, mode="RGB")) == [
        "image of 6 x 4 pixels, 3 channels, uint8"
    ]
    assert value_lines(Time.from_ns(0)) == ["Time"]
