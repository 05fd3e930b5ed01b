# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""VoxelGrid: one mean point for each voxel, with a given size or a given number of points."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.point_cloud_downsampling.interface import PointCloudDownsamplingInputs
from cdff_core.dfns.point_cloud_downsampling.voxel_grid import VoxelGrid


def make_node(**config: object) -> VoxelGrid:
    node = VoxelGrid()
    node.configure(config)
    return node


def test_the_points_of_a_voxel_are_replaced_by_their_mean() -> None:
    points = np.array([[0.0, 0, 0], [0.4, 0.2, 0.2], [1.5, 0, 0]])
    outputs = make_node(voxel_m=1.0).process(PointCloudDownsamplingInputs(points=points))
    np.testing.assert_allclose(outputs.points, [[0.2, 0.1, 0.1], [1.5, 0, 0]])
    assert outputs.voxel_m == 1.0


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_the_requested_number_of_points_is_reached_at_any_scale(
    rng: np.random.Generator, scale: float
) -> None:
    points = rng.normal(size=(20_000, 3)) * scale
    outputs = make_node(max_points=2000).process(PointCloudDownsamplingInputs(points=points))
    assert 1900 <= len(outputs.points) <= 2100


def test_a_small_cloud_is_unchanged(rng: np.random.Generator) -> None:
    points = rng.normal(size=(50, 3))
    outputs = make_node(max_points=100).process(PointCloudDownsamplingInputs(points=points))
    np.testing.assert_array_equal(outputs.points, points)
    assert outputs.voxel_m == 0.0


def test_voxels_too_small_for_the_extent_are_refused() -> None:
    with pytest.raises(InputError, match="too small"):
        make_node(voxel_m=1e-9).process(
            PointCloudDownsamplingInputs(points=np.array([[0.0, 0, 0], [1e6, 1e6, 1e6]]))
        )
