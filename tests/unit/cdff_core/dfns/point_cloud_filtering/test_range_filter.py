# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""RangeFilter: removes points that are too near, too far, on the robot or not finite."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError
from cdff_core.dfns.point_cloud_filtering.interface import PointCloudFilteringInputs
from cdff_core.dfns.point_cloud_filtering.range_filter import RangeFilter

POINTS = np.array(
    [[0.1, 0, 0], [1, 0, 0], [5, 0, 0], [np.nan, 0, 0], [2, 0.1, 0], [np.inf, 0, 0]], dtype=np.float64
)


def make_node(**config: object) -> RangeFilter:
    node = RangeFilter()
    node.configure(config)
    return node


def test_points_outside_the_limits_are_removed_and_the_others_keep_their_order() -> None:
    outputs = make_node(min_range_m=0.5, max_range_m=4.0).process(PointCloudFilteringInputs(points=POINTS))
    np.testing.assert_array_equal(outputs.kept, [1, 4])
    np.testing.assert_array_equal(outputs.filtered_points, POINTS[[1, 4]])


def test_points_on_the_robot_are_removed() -> None:
    outputs = make_node(self_mask_m=[0.5, -0.2, -0.2, 1.5, 0.2, 0.2]).process(
        PointCloudFilteringInputs(points=POINTS)
    )
    np.testing.assert_array_equal(outputs.kept, [0, 2, 4])


def test_limits_that_exclude_all_points_are_refused() -> None:
    with pytest.raises(InputError, match="min_range_m=100"):
        make_node(min_range_m=100.0).process(PointCloudFilteringInputs(points=POINTS))


@pytest.mark.parametrize(
    "config", [{"min_range_m": 5.0, "max_range_m": 1.0}, {"self_mask_m": [1, 0, 0, 0, 1, 1]}]
)
def test_limits_in_the_wrong_order_are_refused(config: dict[str, object]) -> None:
    with pytest.raises(ConfigurationError):
        make_node(**config)


def test_an_array_of_another_shape_is_refused() -> None:
    with pytest.raises(InputError, match=r"points \(4, 2\): expected float64\[n,3\]"):
        make_node().process(PointCloudFilteringInputs(points=np.zeros((4, 2))))


def test_clouds_in_a_map_projection_are_kept(rng: np.random.Generator) -> None:
    points = rng.uniform(0.0, 300.0, (50, 3)) + np.array([5.13e5, 5.403e6, 300.0])
    assert len(make_node().process(PointCloudFilteringInputs(points=points)).kept) == 50


def test_without_a_largest_range_points_far_from_all_others_are_removed(rng: np.random.Generator) -> None:
    points = rng.uniform(0.0, 300.0, (50, 3)) + np.array([5.13e5, 5.403e6, 300.0])
    points[7] = [1e9, 0.0, 0.0]
    points[9] = [np.inf, 0.0, 0.0]
    kept_indices = make_node().process(PointCloudFilteringInputs(points=points)).kept
    assert np.array_equal(np.setdiff1d(np.arange(50), kept_indices), [7, 9])
