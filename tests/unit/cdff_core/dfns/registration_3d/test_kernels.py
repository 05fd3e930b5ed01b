# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled pairs and normal equations agree with sums over an exhaustive search."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import kd_tree
from cdff_core.dfns.registration_3d._kernels import (
    KERNELS,
    centre_and_radius,
    distribution_equations,
    no_pairs,
    pair,
    plane_distances,
    plane_equations,
    weight_of,
)

Array = np.ndarray


def distances(points: Array, moved_points: Array) -> Array:
    return np.linalg.norm(points[None] - moved_points[:, None], axis=2)


@pytest.mark.parametrize("gate", [0.25, 0.6, 5.0])
def test_pairs_of_each_iteration_are_those_of_an_exhaustive_search(gate: float) -> None:
    rng = np.random.default_rng(1)
    target, source = rng.uniform(0.0, 2.0, (90, 3)), rng.uniform(0.0, 2.0, (40, 3))
    tree, pairs = kd_tree(target), no_pairs(len(source))
    steps = [
        np.zeros(6),
        [1e-3, 0, 0, 0, 0, 1e-3],
        [0.02, -0.01, 0.0, 0.02, 0, 0],
        [0.5, 0.4, -0.2, 0, 0.3, 0],
    ]
    T = np.eye(4)
    for step in [*steps, *steps[::-1]]:
        T = se3.exp_se3(step) @ T
        count = pair(tree, source, T, gate, pairs)
        moved_points = source @ T[:3, :3].T + T[:3, 3]
        d = distances(tree.points, moved_points)
        nearest = np.sort(d, axis=1)
        is_paired = nearest[:, 0] < gate
        np.testing.assert_allclose(pairs.moved, moved_points, atol=1e-13)
        np.testing.assert_array_equal(pairs.row, np.where(is_paired, d.argmin(axis=1), -1))
        assert count == is_paired.sum()
        others = np.where(is_paired, nearest[:, 1], nearest[:, 0])
        assert np.all(pairs.bound_m <= others + 1e-12)
        assert np.all(pairs.bound_m <= gate)
    # After a new search the bound is that of the next nearest point, or the gate.
    fresh = no_pairs(len(source))
    pair(tree, source, T, gate, fresh)
    np.testing.assert_allclose(fresh.bound_m, np.minimum(others, gate), atol=1e-12)


def test_a_point_at_the_distance_of_the_gate_is_not_paired() -> None:
    tree, source = kd_tree(np.array([[0.0, 0.0, 0.0]])), np.array([[0.5, 0, 0], [0, 0.499, 0], [0, 0, 0.501]])
    pairs = no_pairs(3)
    assert pair(tree, source, np.eye(4), 0.5, pairs) == 1
    np.testing.assert_array_equal(pairs.row, [-1, 0, -1])
    assert pair(tree, source, np.eye(4), 0.49, pairs) == 0
    np.testing.assert_array_equal(pairs.row, [-1, -1, -1])
    assert pair(tree, source, np.eye(4), 0.6, pairs) == 3


@pytest.mark.parametrize(
    ("bound_m", "shift_m", "expected_m"),
    [
        (0.5, 0.125, 0.375),  # the pair is at 0.125: no other point can be nearer
        (0.5, 0.25, 0.25),  # the pair is as far as the bound of the others
        (0.5, 0.375, 1.625),  # 0.125 for the others is less than 0.375: searched
        (0.0, 0.0, 2.0),  # nothing is known of the others: searched
        (-np.inf, 0.25, 1.75),
        (3.0, 0.0, 3.0),  # all others are beyond the gate
        (2.75, 0.0, 2.75),
        (3.5, 0.25, 3.25),
    ],
)
def test_a_pair_is_searched_only_if_another_point_can_be_nearer(
    bound_m: float, shift_m: float, expected_m: float
) -> None:
    """The bound of the distance to the other point, at 2 m, is exact after a search only."""
    tree, pairs = kd_tree(np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])), no_pairs(1)
    pair(tree, np.zeros((1, 3)), np.eye(4), 3.0, pairs)
    assert pairs.bound_m[0] == 2.0
    pairs.bound_m[0] = bound_m
    assert pair(tree, np.zeros((1, 3)), se3.transform(np.eye(3), [shift_m, 0.0, 0.0]), 3.0, pairs) == 1
    assert tree.order[pairs.row[0]] == 0
    assert pairs.bound_m[0] == expected_m


def test_there_are_no_pairs_before_the_first_search() -> None:
    pairs = no_pairs(3)
    np.testing.assert_array_equal(pairs.row, [-1, -1, -1])
    np.testing.assert_array_equal(pairs.moved, np.zeros((3, 3)))
    assert np.all(pairs.bound_m == -np.inf)
    assert pair(kd_tree(np.eye(3)), np.zeros((0, 3)), np.eye(4), 1.0, no_pairs(0)) == 0


@pytest.fixture
def matched() -> tuple[Array, Array, Array, Array]:
    """Return points, unit normals, rows with two points that are not paired, and the transformed points."""
    rng = np.random.default_rng(2)
    points, normals = rng.normal(size=(15, 3)), rng.normal(size=(15, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    row = rng.integers(0, 15, 12)
    row[[0, 7]] = -1
    return points, normals, row, points[row] + rng.normal(0.0, 0.3, (12, 3)) + [3.0, -1.0, 2.0]


def test_plane_distances_are_signed_and_in_the_order_of_the_source(matched: tuple[Array, ...]) -> None:
    points, normals, row, moved_points = matched
    expected = [(p - points[j]) @ normals[j] for p, j in zip(moved_points, row, strict=True) if j >= 0]
    np.testing.assert_allclose(plane_distances(points, normals, row, moved_points), expected, rtol=1e-12)
    assert len(plane_distances(points, normals, np.full(12, -1), moved_points)) == 0
    assert len(plane_distances(points, normals, np.zeros(1, np.int64), moved_points[:1])) == 1


def test_centre_and_radius_are_those_of_the_paired_points(matched: tuple[Array, ...]) -> None:
    _, _, row, moved_points = matched
    centre, radius = centre_and_radius(row, moved_points)
    paired = moved_points[row >= 0]
    np.testing.assert_allclose(centre, paired.mean(axis=0), rtol=1e-13)
    assert radius == pytest.approx(np.sqrt(np.mean(np.sum((paired - paired.mean(axis=0)) ** 2, axis=1))))
    centre, radius = centre_and_radius(np.full(12, -1), moved_points)
    assert (centre.tolist(), radius) == ([0.0, 0.0, 0.0], 1e-9)
    centre, radius = centre_and_radius(np.zeros(1, np.int64), moved_points[1:2])
    assert (centre.tolist(), radius) == (moved_points[1].tolist(), 1e-9)


#: Weights of Babin et al. 2019, table I, at u = 0, 0.5, 1 and 2 kernel widths.
WEIGHTS = {
    "none": [1.0, 1.0, 1.0, 1.0],
    "tukey": [1.0, 0.5625, 0.0, 0.0],
    "huber": [1.0, 1.0, 1.0, 0.5],
    "cauchy": [1.0, 0.8, 0.5, 0.2],
    "geman_mcclure": [1.0, 0.64, 0.25, 0.04],
}


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_weights_are_those_of_the_named_kernel(name: str, sign: float) -> None:
    weights = [weight_of(sign * u, KERNELS[name]) for u in (0.0, 0.5, 1.0, 2.0)]
    np.testing.assert_allclose(weights, WEIGHTS[name], rtol=1e-14)
    if name == "tukey":
        assert weight_of(sign * 0.999999, KERNELS[name]) > 0.0


def expected_system(jacobians: Array, errors: Array, information: Array) -> tuple[Array, Array]:
    """Return ``sum J^T A J`` and ``sum J^T A e`` of arrays (n, d, 6), (n, d) and (n, d, d)."""
    return (
        np.einsum("nia,nij,njb->ab", jacobians, information, jacobians),
        np.einsum("nia,nij,nj->a", jacobians, information, errors),
    )


@pytest.mark.parametrize("name", KERNELS)
def test_plane_equations_are_the_weighted_sum_over_the_pairs(name: str, matched: tuple[Array, ...]) -> None:
    points, normals, row, moved_points = matched
    centre, radius, width = np.array([0.5, 2.0, -1.0]), 1.7, 2.5
    J, errors, weights = [], [], []
    for p, j in zip(moved_points, row, strict=True):
        if j >= 0:
            q, n = points[j], normals[j]
            J.append([[*n, *np.cross((p - centre) / radius, n)]])
            errors.append([n @ (p - q)])
            u = abs(errors[-1][0] / width)
            w = {"none": 1.0, "tukey": max(1.0 - u * u, 0.0) ** 2, "huber": 1.0 / max(u, 1.0),
                 "cauchy": 1.0 / (1.0 + u * u), "geman_mcclure": (1.0 + u * u) ** -2.0}[name]  # fmt: skip
            weights.append([[w]])
    assert min(abs(np.ravel(errors))) < width < max(abs(np.ravel(errors)))
    H, g = expected_system(np.array(J), np.array(errors), np.array(weights))
    actual_H, actual_g = plane_equations(
        points, normals, row, moved_points, centre, radius, width, KERNELS[name]
    )
    np.testing.assert_allclose(actual_H, H, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(actual_g, g, rtol=1e-11, atol=1e-13)


def test_distribution_equations_are_the_weighted_sum_over_the_pairs(matched: tuple[Array, ...]) -> None:
    means, _, row, moved_points = matched
    rng = np.random.default_rng(5)
    factors = rng.normal(size=(15, 3, 3))
    information = factors @ np.swapaxes(factors, 1, 2) + 0.1 * np.eye(3)
    centre, radius, width = np.array([0.5, 2.0, -1.0]), 1.7, 4.0
    J, errors, weights = [], [], []
    for p, j in zip(moved_points, row, strict=True):
        if j >= 0:
            e = p - means[j]
            J.append(np.hstack([np.eye(3), -se3.skew((p - centre) / radius)]))
            errors.append(e)
            weights.append(np.exp(-(e @ information[j] @ e) / (2.0 * width**2)) * information[j])
    H, g = expected_system(np.array(J), np.array(errors), np.array(weights))
    actual_H, actual_g = distribution_equations(means, information, row, moved_points, centre, radius, width)
    np.testing.assert_allclose(actual_H, H, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(actual_g, g, rtol=1e-11, atol=1e-13)


def test_without_pairs_the_equations_are_zero(matched: tuple[Array, ...]) -> None:
    points, normals, row, moved_points = matched
    none, centre = np.full(len(row), -1), np.zeros(3)
    for H, g in (
        plane_equations(points, normals, none, moved_points, centre, 1.0, 1.0, 0),
        distribution_equations(points, np.tile(np.eye(3), (15, 1, 1)), none, moved_points, centre, 1.0, 1.0),
    ):
        assert not H.any()
        assert not g.any()
