# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The compiled kd-tree agrees with scipy's, and planes through neighbourhoods with an eigendecomposition."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cdff_common.geometry.kdtree import kd_tree, nearest, neighbours, spacing
from cdff_common.geometry.plane_fits import plane_fits


@pytest.mark.parametrize(("n", "axis"), [(1, 0), (2, 0), (11, 0), (500, 1), (3000, 0), (3000, 2)])
def test_neighbours_agree_with_an_exhaustive_search(n: int, axis: int, rng: np.random.Generator) -> None:
    points = rng.normal(size=(n, 3)) * np.roll([10.0, 3.0, 0.1], axis)
    queries = rng.normal(size=(200, 3)) * 8.0
    tree, reference = kd_tree(points), cKDTree(points)
    distance, row = nearest(tree, queries)
    np.testing.assert_allclose(distance, reference.query(queries)[0])
    np.testing.assert_allclose(np.linalg.norm(points[row] - queries, axis=1), distance)
    count = min(n, 7)
    distances, rows = neighbours(tree, queries, count)
    np.testing.assert_allclose(distances, reference.query(queries, k=np.arange(1, count + 1))[0])
    assert np.all(np.sort(rows, axis=1)[:, 1:] != np.sort(rows, axis=1)[:, :-1])


def test_a_maximum_distance_includes_points_at_exactly_this_distance() -> None:
    tree = kd_tree(np.array([[0.0, 0, 0], [5.0, 0, 0]]))
    distance, row = nearest(tree, np.array([[2.0, 0, 0], [2.5, 0, 0]]), 2.0)
    np.testing.assert_array_equal(distance, [2.0, np.inf])
    np.testing.assert_array_equal(row, [0, -1])


def test_neighbours_beyond_the_number_of_points_are_marked_as_missing() -> None:
    distance, row = neighbours(kd_tree(np.eye(3)), np.zeros((1, 3)), 5)
    np.testing.assert_array_equal(np.isfinite(distance[0]), [True, True, True, False, False])
    assert list(row[0, 3:]) == [-1, -1]


def test_coincident_points_are_found_as_separate_neighbours() -> None:
    tree = kd_tree(np.tile([1.0, 2.0, 3.0], (1000, 1)))
    distance, row = neighbours(tree, np.array([[1.0, 2.0, 3.0]]), 4)
    assert np.all(distance == 0.0)
    assert len(set(row[0])) == 4


def test_spacing_is_the_median_distance_to_the_nearest_neighbour() -> None:
    x, y = np.meshgrid(np.arange(50.0), np.arange(50.0))
    assert spacing(kd_tree(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1) * 0.2)) == pytest.approx(
        0.2
    )


def test_planes_have_the_principal_axes_and_variances_of_their_neighbourhoods(
    rng: np.random.Generator,
) -> None:
    points = rng.normal(size=(800, 3)) * [3.0, 2.0, 0.05]
    normals, means, variances = plane_fits(kd_tree(points), 12)
    _, row = cKDTree(points).query(points, k=12)
    offset = points[row] - points[row].mean(axis=1, keepdims=True)
    value, vector = np.linalg.eigh(np.einsum("nki,nkj->nij", offset, offset) / 12)
    np.testing.assert_allclose(means, points[row].mean(axis=1), atol=1e-12)
    np.testing.assert_allclose(variances, value, atol=1e-12)
    np.testing.assert_allclose(np.abs(np.einsum("ni,ni->n", vector[:, :, 0], normals)), 1.0, atol=1e-9)
