# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The kd-tree agrees with exhaustive searches in numpy, for ties and boundaries too."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.geometry.kdtree import (
    KdTree,
    kd_tree,
    nearest,
    nearest_row,
    nearest_rows,
    nearest_two,
    neighbours,
    scratch,
    spacing,
)

Float = NDArray[np.float64]


def grid(side: int) -> Float:
    """Return the points of a cubic grid with integer coordinates, whose distances have many ties."""
    axis = np.arange(float(side))
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)


def squared(points: Float, query: Float) -> Float:
    return np.asarray(((points - query) ** 2).sum(axis=1))


def clouds(rng: np.random.Generator) -> list[Float]:
    half_steps = rng.integers(0, 6, (150, 3)) / 2.0  # many coincident points
    return [rng.normal(size=(300, 3)) * [4.0, 1.0, 0.1], grid(5), half_steps]


@pytest.mark.parametrize("n", [1, 10, 11, 20, 21, 160, 161])
def test_leaves_have_at_most_ten_points_and_nodes_split_the_widest_axis_at_the_median(
    n: int, rng: np.random.Generator
) -> None:
    cloud = rng.normal(size=(n, 3)) * [1.0, 5.0, 2.0]
    tree = kd_tree(cloud)
    depth = 0
    while n // 2**depth > 10:
        depth += 1
    assert len(tree.axis) == len(tree.split) == 2**depth - 1
    assert len(tree.start) == 2**depth + 1
    assert sorted(tree.order) == list(range(n))
    np.testing.assert_array_equal(tree.points, cloud[tree.order])

    def check(node: int, rows: slice) -> list[int]:
        """Check the subtree of the rows and return the first row of each of its leaves."""
        if node >= len(tree.axis):
            return [rows.start]
        extent = np.ptp(tree.points[rows], axis=0)
        assert tree.axis[node] == np.argmax(extent)
        middle = (rows.start + rows.stop) // 2
        values = tree.points[:, tree.axis[node]]
        assert tree.split[node] == np.sort(values[rows])[middle - rows.start]
        assert values[rows.start : middle].max() <= tree.split[node] <= values[middle : rows.stop].min()
        return check(2 * node + 1, slice(rows.start, middle)) + check(2 * node + 2, slice(middle, rows.stop))

    assert tree.start.tolist() == [*check(0, slice(0, n)), n]


def test_distances_are_those_of_an_exhaustive_search_with_ties(rng: np.random.Generator) -> None:
    for cloud in clouds(rng):
        tree, queries = kd_tree(cloud), np.vstack([cloud[:40], cloud[:40] + 0.5, rng.normal(size=(40, 3))])
        distance, row = nearest(tree, queries)
        distances, rows = neighbours(tree, queries, 9)
        for i, query in enumerate(queries):
            expected = np.sort(squared(cloud, query))
            np.testing.assert_allclose(distance[i] ** 2, expected[0], rtol=1e-12, atol=0)
            np.testing.assert_allclose(distances[i] ** 2, expected[:9], rtol=1e-12, atol=0)
            np.testing.assert_allclose(squared(cloud[[row[i]]], query), expected[0], rtol=1e-12, atol=0)
            np.testing.assert_allclose(squared(cloud[rows[i]], query), expected[:9], rtol=1e-12, atol=0)
            assert len(set(rows[i])) == 9


def test_the_search_has_no_maximum_distance_unless_one_is_given() -> None:
    distance, row = nearest(kd_tree(np.zeros((1, 3))), np.array([[1e100, 0.0, 0.0]]))
    assert (distance[0], row[0]) == (1e100, 0)


@pytest.mark.parametrize("limit_m", [0.0, 0.1, 0.3, 1.0, 3.0])
def test_the_maximum_distance_is_inclusive_and_the_next_number_below_it_is_not(limit_m: float) -> None:
    tree = kd_tree(np.vstack([np.zeros((1, 3)), 100.0 + grid(3)]))
    query = np.array([[limit_m, 0.0, 0.0]])
    assert nearest(tree, query, limit_m)[1][0] == 0
    if limit_m:
        distance, row = nearest(tree, query, limit_m * (1.0 - 1e-12))
        assert (distance[0], row[0]) == (np.inf, -1)


def test_trees_and_queries_may_be_empty() -> None:
    empty = kd_tree(np.zeros((0, 3)))
    distance, row = nearest(empty, np.zeros((2, 3)))
    assert (distance.tolist(), row.tolist()) == ([np.inf] * 2, [-1] * 2)
    distances, rows = neighbours(empty, np.zeros((1, 3)), 2)
    assert (distances.tolist(), rows.tolist()) == ([[np.inf] * 2], [[-1] * 2])
    tree = kd_tree(grid(3))
    assert nearest(tree, np.zeros((0, 3)))[0].shape == (0,)
    assert neighbours(tree, np.zeros((0, 3)), 4)[1].shape == (0, 4)


def two_of(tree: KdTree, query: Float, row: int, row_d2: float, gate: float) -> tuple[int, float, float]:
    return nearest_two(tree, *query, row, row_d2, gate, *scratch())


def test_the_second_distance_is_that_of_the_second_nearest_point_up_to_the_gate(
    rng: np.random.Generator,
) -> None:
    for cloud in clouds(rng):
        tree = kd_tree(cloud)
        for query in np.vstack([rng.normal(size=(25, 3)) * 3.0, cloud[:10], cloud[:10] + 0.25]):
            d2 = squared(tree.points, query)
            first, second = np.sort(d2)[:2]
            for gate in (0.3, 1.0, 2.5, 100.0):
                best, best_d2, bound = two_of(tree, query, -1, np.inf, gate)
                assert bound == pytest.approx(min(np.sqrt(second), gate), rel=1e-12, abs=0)
                assert (best >= 0) == (first < gate**2)
                if best >= 0:
                    assert best_d2 == pytest.approx(first, rel=1e-12, abs=0)
                    assert d2[best] == pytest.approx(first, rel=1e-12, abs=0)
                for row in rng.integers(0, len(cloud), 3):
                    best, best_d2, bound = two_of(tree, query, int(row), d2[row], gate)
                    others = np.delete(d2, row)
                    expected = d2[row] if others.min() >= min(d2[row], gate**2) else others.min()
                    assert best_d2 == pytest.approx(expected, rel=1e-12, abs=0)
                    assert d2[best] == pytest.approx(expected, rel=1e-12, abs=0)
                    remaining = np.delete(d2, best).min()
                    assert bound == pytest.approx(min(np.sqrt(remaining), gate), rel=1e-12, abs=0)


def test_an_initial_row_remains_unless_another_one_is_nearer_than_it() -> None:
    tree = kd_tree(np.array([[0.0, 0, 0], [2.0, 0, 0], [5.0, 0, 0]]))
    query = np.array([1.0, 0.0, 0.0])  # as far from row 0 as from row 1
    for row in (0, 1):
        assert nearest_row(tree, *query, row, 1.0, *scratch()) == (row, 1.0)
        assert two_of(tree, query, row, 1.0, 10.0) == (row, 1.0, 1.0)
    assert nearest_row(tree, *query, 2, 16.0, *scratch()) == (0, 1.0)
    assert nearest_row(tree, *query, -1, 1.0, *scratch()) == (-1, 1.0)
    assert two_of(tree, query, -1, np.inf, 1.0) == (-1, np.inf, 1.0)


def test_rows_are_those_below_the_given_squared_distance_nearest_first(rng: np.random.Generator) -> None:
    for cloud in clouds(rng):
        tree = kd_tree(cloud)
        for query in np.vstack([cloud[:20], rng.normal(size=(20, 3))]):
            d2 = squared(tree.points, query)
            for worst in (0.25, 1.0, 2.0, np.inf):
                rows, d2s = np.full(6, -9), np.full(6, -9.0)
                filled = nearest_rows(tree, *query, worst, rows, d2s, *scratch())
                expected = np.sort(d2[d2 < worst])[:6]
                np.testing.assert_allclose(d2s[:filled], expected, rtol=1e-12, atol=0)
                np.testing.assert_allclose(d2[rows[:filled]], expected, rtol=1e-12, atol=0)
                assert np.all(rows[filled:] == -9)


def test_the_spacing_is_sampled_at_regular_rows_of_the_tree_and_above_zero(rng: np.random.Generator) -> None:
    cloud = rng.normal(size=(200, 3))
    tree = kd_tree(cloud)
    second = np.array([np.sqrt(np.sort(squared(cloud, query))[1]) for query in tree.points])
    assert spacing(tree) == pytest.approx(np.median(second))
    assert spacing(tree, 50) == pytest.approx(np.median(second[::4]))
    assert spacing(tree, 60) == pytest.approx(np.median(second[::3]))
    many = kd_tree(rng.normal(size=(20_000, 3)))
    assert spacing(many) == spacing(many, 5000)
    assert spacing(many) != spacing(many, 10_000)
    assert spacing(kd_tree(np.zeros((30, 3)))) == 1e-9
    assert spacing(kd_tree(grid(1))) == np.inf  # a single point has no neighbour
