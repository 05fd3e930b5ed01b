# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Voxels of the compiled hash table are those of sorted cell indices by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry.voxels import downsampled, extent, voxel_for, voxel_means, voxel_rows

Array = np.ndarray


def cells(points: Array, voxel_m: float) -> tuple[Array, Array]:
    """Return the sorted cells (m, 3) that are occupied, and the row in them of each point."""
    indices = np.floor((points - points.min(axis=0)) / voxel_m).astype(int)
    unique, row = np.unique(indices, axis=0, return_inverse=True)
    return unique, row.ravel()


@pytest.mark.parametrize(("n", "voxel_m"), [(1, 0.5), (50, 0.5), (400, 0.31), (3000, 0.13), (20, 100.0)])
def test_means_and_numbers_are_those_of_the_occupied_cells(n: int, voxel_m: float) -> None:
    points = np.random.default_rng(n).normal(size=(n, 3)) * [1.0, 2.0, 0.5] + [10.0, -20.0, 3.0]
    unique, row = cells(points, voxel_m)
    expected = np.array([points[row == i].mean(axis=0) for i in range(len(unique))])
    np.testing.assert_allclose(voxel_means(points, voxel_m), expected, rtol=1e-12)
    voxel, keys = voxel_rows(points, voxel_m)
    assert len(keys) == len(unique)
    first = np.unique(row, return_index=True)[1]
    np.testing.assert_array_equal(voxel, np.argsort(np.argsort(first))[row])
    size = unique.max(axis=0) + 1
    order = np.argsort(first)
    np.testing.assert_array_equal(keys, (unique[order] @ [size[1] * size[2], size[2], 1]))


def test_a_point_on_the_border_is_in_the_upper_voxel() -> None:
    points = np.array([[0.0, 0, 0], [0.25, 0, 0], [0.5, 0, 0], [0.5, 0, 1.0]])
    np.testing.assert_array_equal(voxel_means(points, 0.5), [[0.125, 0, 0], [0.5, 0, 0], [0.5, 0, 1.0]])


def test_no_points_have_no_voxels_and_too_small_voxels_are_refused() -> None:
    voxel, keys = voxel_rows(np.zeros((0, 3)), 1.0)
    assert (voxel.shape, keys.shape) == ((0,), (0,))
    far = np.array([[0.0, 0, 0], [1e6, 1e6, 1e6]])
    with pytest.raises(InputError, match="voxel_m"):
        voxel_rows(far, 0.5)
    assert len(voxel_rows(far, 1.0)[1]) == 2


def test_the_extent_is_that_of_all_points() -> None:
    points = np.random.default_rng(2).normal(size=(9, 3))
    low, high = extent(points)
    np.testing.assert_array_equal(low, points.min(axis=0))
    np.testing.assert_array_equal(high, points.max(axis=0))


@pytest.mark.parametrize("target", [10, 60, 300])
@pytest.mark.parametrize("flatness", [1.0, 0.0])
def test_the_edge_gives_the_desired_number_of_voxels_within_a_tenth(target: int, flatness: float) -> None:
    points = np.random.default_rng(3).uniform(0.0, 10.0, (2000, 3)) * [1.0, 1.0, flatness]
    voxel_m = voxel_for(points, target)
    occupied = len(cells(points, voxel_m)[0])
    assert abs(occupied - target) <= 0.1 * target
    means, edge_m = downsampled(points, target)
    assert edge_m == voxel_m
    np.testing.assert_allclose(means, voxel_means(points, voxel_m), rtol=1e-12)


def test_a_deviation_of_exactly_a_tenth_ends_the_search() -> None:
    points = np.linspace(0.0, 1.0, 1000)[:, None] * [1.0, 0.0, 0.0]
    first_m = 1.0 / np.sqrt(8.0 * 10)  # edge with which the search starts: 9 voxels on a line
    assert len(cells(points, first_m)[0]) == 9
    assert voxel_for(points, 10) == pytest.approx(first_m)


def test_no_more_points_than_desired_and_coincident_points_are_not_changed() -> None:
    points = np.random.default_rng(4).normal(size=(20, 3))
    assert voxel_for(points, 20) == 0.0
    assert voxel_for(points, 19) > 0.0
    reduced, voxel_m = downsampled(points, 20)
    assert voxel_m == 0.0
    np.testing.assert_array_equal(reduced, points)
    same = np.tile([1.0, 2.0, 3.0], (30, 1))
    reduced, voxel_m = downsampled(same, 5)
    assert voxel_m == 0.0
    np.testing.assert_array_equal(reduced, same)


def test_a_count_that_no_voxels_have_gives_the_means_of_the_closest_ones() -> None:
    """The points are ten clusters: voxels hold at most one cluster each, or several."""
    clusters = np.repeat(np.arange(10.0)[:, None] * [1.0, 0.0, 0.0], 500, axis=0)
    points = clusters + np.random.default_rng(1).uniform(0.0, 1e-7, (5000, 3))
    means, voxel_m = downsampled(points, 100)
    assert voxel_m > 0.0
    assert len(means) < 5000
    np.testing.assert_allclose(means, voxel_means(points, voxel_m))
