# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled plane fits agree with an eigendecomposition by LAPACK of the covariance of each neighbourhood."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry.kdtree import kd_tree
from cdff_common.geometry.plane_fits import _flat_eigen, eigen, plane_fits
from cdff_common.geometry.small_vectors import cross, rotated

Array = np.ndarray
NAN = float("nan")


def symmetric(rng: np.random.Generator, values: list[float]) -> Array:
    """Return a matrix with random eigenvectors and the given eigenvalues."""
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    M = Q @ np.diag(values) @ Q.T
    return 0.5 * (M + M.T)


def lower(M: Array) -> Array:
    """Return the lower triangle, with NaN above the diagonal."""
    return np.where(np.tri(3, dtype=bool), M, NAN)


MATRICES = [
    symmetric(np.random.default_rng(seed), values)
    for seed, values in enumerate(
        [
            [1.0, 2.0, 4.0],
            [1.0, 2.0, 4.0],
            [-3.0, 0.5, 2.0],
            [1e-9, 1.0, 1.5],
            [0.0, 1e-6, 1.0],
            [2.0, 2.0, 5.0],
            [1.0, 3.0, 3.0],
            [1e6, 2e6, 7e6],
        ]
    )
]
SPARSE = [
    np.diag([3.0, 1.0, 2.0]),
    np.diag([1.0, 2.0, 3.0]),
    np.diag([3.0, 2.0, 1.0]),
    np.eye(3),
    np.zeros((3, 3)),
    np.array([[1.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 0.7]]),
    np.array([[1.0, 0.0, -0.5], [0.0, 2.0, 0.0], [-0.5, 0.0, 1.0]]),
    np.array([[5.0, 0.0, 0.0], [0.0, 2.0, 0.9], [0.0, 0.9, 1.0]]),
    np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]]),
]


@pytest.mark.parametrize("M", MATRICES + SPARSE)
def test_jacobi_rotations_give_the_eigenvalues_and_eigenvectors_of_lapack(M: Array) -> None:
    values, vectors = np.full(3, NAN), np.full((3, 3), NAN)
    eigen(lower(M), values, vectors)
    size = max(float(np.abs(M).max()), 1.0)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(M), atol=1e-13 * size)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(3), atol=1e-13)
    np.testing.assert_allclose(M @ vectors, vectors * values, atol=1e-12 * size)


@pytest.mark.parametrize("M", [*MATRICES[:2], MATRICES[3], *MATRICES[6:], *SPARSE[:3]])
def test_the_closed_form_gives_the_eigenvalues_and_the_least_eigenvector_of_lapack(M: Array) -> None:
    values, axis = np.full(3, NAN), np.full(3, NAN)
    assert _flat_eigen(lower(M), values, axis)
    expected, vectors = np.linalg.eigh(M)
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-8 * expected[2])
    assert values[0] == pytest.approx(expected[0], abs=2e-15 * expected[2])
    assert np.linalg.norm(axis) == pytest.approx(1.0, abs=1e-14)
    assert abs(axis @ vectors[:, 0]) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(("seed", "difference", "is_computed"), [(1, 0.99e-3, False), (2, 1.01e-3, True)])
def test_the_closed_form_is_refused_if_the_least_two_eigenvalues_differ_by_a_thousandth_of_the_largest(
    seed: int, difference: float, is_computed: bool
) -> None:
    M = symmetric(np.random.default_rng(seed), [2.0, 2.0 + 5.0 * difference, 5.0])
    assert _flat_eigen(lower(M), np.empty(3), np.empty(3)) is is_computed
    assert not _flat_eigen(lower(np.eye(3)), np.empty(3), np.empty(3))
    assert not _flat_eigen(lower(np.zeros((3, 3))), np.empty(3), np.empty(3))


@pytest.mark.parametrize(("values", "is_computed"), [([1.0, 1.0, 4.0], False), ([1.0, 4.0, 4.0], True)])
def test_rounding_of_equal_eigenvalues_gives_no_cosine_beyond_one(
    values: list[float], is_computed: bool
) -> None:
    rng = np.random.default_rng(7)
    for _ in range(60):
        result = np.full(3, NAN)
        assert _flat_eigen(symmetric(rng, values), result, np.empty(3)) is is_computed
        np.testing.assert_allclose(result, values, atol=1e-6)


def fits_by_numpy(points: Array, count: int) -> tuple[Array, Array, Array]:
    """Return normals, means and ascending variances of the ``count`` nearest points of each point."""
    normals, means, variances = [], [], []
    for p in points:
        near = points[np.argsort(np.linalg.norm(points - p, axis=1), kind="stable")[:count]]
        values, vectors = np.linalg.eigh(np.cov(near.T, bias=True))
        normals.append(vectors[:, 0])
        means.append(near.mean(axis=0))
        variances.append(np.maximum(values, 0.0))
    return np.array(normals), np.array(means), np.array(variances)


@pytest.mark.parametrize(("n", "count"), [(60, 8), (60, 5), (12, 12), (7, 12), (40, 4)])
def test_planes_agree_with_the_eigendecomposition_of_each_neighbourhood(n: int, count: int) -> None:
    rng = np.random.default_rng(n + count)
    points = rng.normal(size=(n, 3)) * [3.0, 2.0, 0.3] + [100.0, -50.0, 7.0]
    points[n // 2 :] += [40.0, 0.0, 5.0]  # two groups, far apart
    normals, means, variances = plane_fits(kd_tree(points), count)
    expected_normals, expected_means, expected_variances = fits_by_numpy(points, count)
    np.testing.assert_allclose(means, expected_means, rtol=1e-12)
    np.testing.assert_allclose(variances, expected_variances, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(normals * expected_normals, axis=1)), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)


def test_points_in_a_plane_have_no_negative_variance_and_coincident_points_a_unit_normal() -> None:
    rng = np.random.default_rng(3)
    plane = np.c_[rng.normal(size=(30, 2)), np.zeros(30)] @ np.linalg.qr(rng.normal(size=(3, 3)))[0] * 100.0
    normals, _, variances = plane_fits(kd_tree(plane), 6)
    assert np.all(variances >= 0.0)
    assert np.all(variances[:, 0] <= 1e-12 * variances[:, 2])
    np.testing.assert_allclose(np.abs(normals @ normals[0]), 1.0, atol=1e-9)
    normals, means, variances = plane_fits(kd_tree(np.tile([1.0, 2.0, 3.0], (20, 1))), 5)
    np.testing.assert_array_equal(variances, np.zeros((20, 3)))
    np.testing.assert_allclose(means, np.tile([1.0, 2.0, 3.0], (20, 1)), rtol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)


def test_a_single_point_and_points_on_a_line_have_a_fit() -> None:
    normals, means, variances = plane_fits(kd_tree(np.array([[1.0, 2.0, 3.0]])), 4)
    np.testing.assert_array_equal(means, [[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(variances, np.zeros((1, 3)))
    assert np.linalg.norm(normals[0]) == pytest.approx(1.0)
    line = np.arange(12.0)[:, None] * np.array([1.0, 2.0, -2.0])
    normals, _, variances = plane_fits(kd_tree(line), 3)
    np.testing.assert_allclose(normals @ [1.0, 2.0, -2.0], np.zeros(12), atol=1e-9)
    np.testing.assert_allclose(variances[1:-1], np.tile([0.0, 0.0, 6.0], (10, 1)), atol=1e-9)


def test_products_of_vectors_agree_with_numpy() -> None:
    rng = np.random.default_rng(4)
    T, a, b = rng.normal(size=(4, 4)), rng.normal(size=3), rng.normal(size=3)
    np.testing.assert_allclose(rotated(T, *a), T[:3, :3] @ a, rtol=1e-13)
    np.testing.assert_allclose(cross(*a, *b), np.cross(a, b), rtol=1e-12)
