# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""VoxelGrid: one mean point per voxel, with a size given or found."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.point_cloud_downsampling._interface import PointCloudDownsamplingInputs
from cdff_core.dfns.point_cloud_downsampling.voxel_grid import VoxelGrid


def made(**config: object) -> VoxelGrid:
    node = VoxelGrid()
    node.configure(config)
    return node


def test_each_voxel_gives_the_mean_of_its_points() -> None:
    points = np.array([[0.0, 0, 0], [0.4, 0.2, 0.2], [1.5, 0, 0]])
    out = made(voxel_m=1.0).process(PointCloudDownsamplingInputs(points))
    np.testing.assert_allclose(out.points, [[0.2, 0.1, 0.1], [1.5, 0, 0]])
    assert float(out.voxel_m) == 1.0


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_the_wanted_number_is_met_at_any_scale(rng: np.random.Generator, scale: float) -> None:
    points = rng.normal(size=(20_000, 3)) * scale
    out = made(max_points=2000).process(PointCloudDownsamplingInputs(points))
    assert 1900 <= len(out.points) <= 2100


def test_a_small_cloud_passes_unchanged(rng: np.random.Generator) -> None:
    points = rng.normal(size=(50, 3))
    out = made(max_points=100).process(PointCloudDownsamplingInputs(points))
    np.testing.assert_array_equal(out.points, points)
    assert float(out.voxel_m) == 0.0


def test_voxels_that_cannot_be_counted_are_refused() -> None:
    with pytest.raises(InputError, match="too small"):
        made(voxel_m=1e-9).process(PointCloudDownsamplingInputs(np.array([[0.0, 0, 0], [1e6, 1e6, 1e6]])))
