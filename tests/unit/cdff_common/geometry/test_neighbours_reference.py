# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Radius searches agree with an exhaustive search in numpy at the boundary, on grids and for empty input."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.geometry.neighbours import radius_neighbours

Float = NDArray[np.float64]


def exhaustive(points: Float, queries: Float, radius: float) -> list[list[int]]:
    offset = points[None, :, :] - queries[:, None, :]
    x, y, z = np.moveaxis(offset, 2, 0)
    is_within = x * x + y * y + z * z <= radius * radius
    return [np.flatnonzero(row).tolist() for row in is_within]


def rows(points: Float, queries: Float, radius: float) -> list[list[int]]:
    start, index = radius_neighbours(points, queries, radius)
    assert len(start) == len(queries) + 1
    assert (start[0], start[-1]) == (0, len(index))
    return [sorted(index[a:b].tolist()) for a, b in pairwise(start)]


@pytest.mark.parametrize("radius", [0.5, 0.75, 1.0, np.sqrt(2.0), 1.5, 3.0])
def test_points_of_a_grid_at_exactly_the_radius_are_neighbours(radius: float) -> None:
    axis = np.arange(-2.0, 3.0)
    points = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    queries = np.vstack([points, points + 0.5, points + np.array([0.25, 0.0, -0.5])])
    assert rows(points, queries, float(radius)) == exhaustive(points, queries, float(radius))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_radius_is_inclusive_along_each_axis_and_the_next_distance_above_is_not(
    axis: int, side: float
) -> None:
    points = np.zeros((2, 3))
    points[0, axis], points[1, axis] = side * 0.375, side * np.nextafter(0.375, 1.0)
    assert rows(points, np.zeros((1, 3)), 0.375) == [[0]]


@pytest.mark.parametrize("radius", [0.05, 0.4, 2.0, 50.0])
def test_anisotropic_clouds_far_from_the_origin_agree_with_an_exhaustive_search(
    radius: float, rng: np.random.Generator
) -> None:
    points = rng.normal(size=(250, 3)) * [5.0, 1.0, 0.2] + [1000.0, -300.0, 20.0]
    queries = np.vstack([points[:40], rng.normal(size=(40, 3)) * [8.0, 2.0, 1.0] + [1000.0, -300.0, 20.0]])
    assert rows(points, queries, radius) == exhaustive(points, queries, radius)


def test_more_neighbours_than_were_allocated_are_returned(rng: np.random.Generator) -> None:
    points = rng.normal(size=(700, 3)) * 0.01
    queries = np.zeros((3, 3))
    assert rows(points, queries, 1.0) == [list(range(700))] * 3


def test_coincident_points_are_separate_neighbours() -> None:
    assert rows(np.ones((5, 3)), np.ones((1, 3)), 1e-3) == [[0, 1, 2, 3, 4]]


def test_neighbours_have_the_order_of_their_cells_and_within_a_cell_that_of_the_cloud() -> None:
    points = np.array([[0.9, 0, 0], [0.0, 0.9, 0], [0.0, 0, 0.9], [0.05, 0, 0], [0.0, 0, 0], [-0.9, 0, 0]])
    _, index = radius_neighbours(points, np.zeros((1, 3)), 1.0)
    assert index.tolist() == [5, 3, 4, 2, 1, 0]
    many = np.zeros((300, 3))
    many[::3, 0] = 0.9
    _, index = radius_neighbours(many, np.zeros((1, 3)), 1.0)
    assert index.tolist() == sorted(range(300), key=lambda i: (many[i, 0], i))


def test_an_empty_cloud_has_no_neighbours_and_no_query_has_no_result() -> None:
    assert rows(np.zeros((0, 3)), np.zeros((2, 3)), 1.0) == [[], []]
    assert rows(np.zeros((4, 3)), np.zeros((0, 3)), 1.0) == []
