# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Distributions of cells and iterations of point-to-plane ICP agree with plain numpy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import kd_tree
from cdff_core.dfns.registration_3d._cells import fit_cells
from cdff_core.dfns.registration_3d._plane_iterations import Limits, iterate

Float = NDArray[np.float64]


def test_cells_are_the_distributions_of_their_points_with_bounded_variances() -> None:
    rng = np.random.default_rng(1)
    corner = np.zeros((1, 3))
    points = np.vstack([corner, rng.uniform(0.0, 3.0, (300, 3)) * [1.0, 1.0, 0.1]])
    for ratio in (1e-6, 0.2):  # a bound below and one above those of the cells
        cells = fit_cells(points, 1.0, 20, ratio)
        assert cells is not None
        key = np.floor(points).astype(int)
        expected = {}
        for cell in np.unique(key, axis=0):
            inside = points[(key == cell).all(axis=1)]
            if len(inside) >= 20:
                values, vectors = np.linalg.eigh(np.cov(inside.T, bias=True))
                values = np.maximum(values, ratio * values[2])
                expected[tuple(cell)] = (inside.mean(axis=0), (vectors / values) @ vectors.T, vectors[:, 0])
        assert len(cells.tree.points) == len(expected) > 5
        for mean, information, normal in zip(
            cells.tree.points, cells.information, cells.normals, strict=True
        ):
            m, A, n = expected[tuple(np.floor(mean).astype(int))]
            np.testing.assert_allclose(mean, m, rtol=1e-12)
            np.testing.assert_allclose(information, A, rtol=1e-8, atol=1e-8 * np.abs(A).max())
            assert abs(n @ normal) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(("points", "is_used"), [(8, True), (9, False)])
def test_a_cell_needs_the_minimum_number_of_points(points: int, is_used: bool) -> None:
    square = np.array([[0.0, 0, 0], [0.5, 0, 0], [0, 0.5, 0], [0.5, 0.5, 0]])
    assert (fit_cells(np.vstack([square, square]), 1.0, points, 1e-3) is not None) == is_used


@pytest.mark.parametrize(("width_m", "is_surface"), [(0.075, True), (0.065, False)])
def test_a_line_is_narrower_than_a_fiftieth_of_its_variance(width_m: float, is_surface: bool) -> None:
    """The ratio of variances of a rectangle's corners is that of its squared sides: 0.0225 and 0.0169."""
    corners = np.array([[0.0, 0, 0], [0.5, 0, 0], [0, width_m, 0], [0.5, width_m, 0]])
    assert (fit_cells(corners, 1.0, 4, 1e-3) is not None) == is_surface


def planes(rng: np.random.Generator) -> tuple[Float, Float]:
    """Return points on three walls of a corner, and their normals."""
    uv = rng.uniform(0.2, 4.0, (3, 150, 2))
    points = np.concatenate([np.insert(uv[i], i, 0.0, axis=1) for i in range(3)])
    return points, np.repeat(np.eye(3), 150, axis=0)


def reference_step(target: Float, normals: Float, source: Float, T: Float, gate: float) -> Float:
    """Return the transform after one damped Gauss-Newton step with equal weights."""
    moved_points = source @ T[:3, :3].T + T[:3, 3]
    distance = np.linalg.norm(moved_points[:, None] - target, axis=2)
    row, is_near = distance.argmin(axis=1), distance.min(axis=1) < gate
    p, q, n = moved_points[is_near], target[row[is_near]], normals[row[is_near]]
    centre = p.mean(axis=0)
    radius = np.sqrt(np.mean(np.sum((p - centre) ** 2, axis=1)))
    J = np.hstack([n, np.cross((p - centre) / radius, n)])
    r = np.sum((p - q) * n, axis=1)
    H = J.T @ J
    x = -np.linalg.solve(H + 1e-6 * np.trace(H) * np.eye(6), J.T @ r)
    rotation = se3.exp_so3(x[3:] / radius)
    return np.asarray(se3.transform(rotation, x[:3] + centre - rotation @ centre) @ T)


def limits(first_gate_m: float, max_iterations: int, min_pairs: int = 10) -> Limits:
    return Limits(first_gate_m, 0.2, 1e-6, 0, 3.0, 0.1, max_iterations, min_pairs)


def test_one_iteration_is_the_gauss_newton_step_of_the_pairs_within_the_gate() -> None:
    rng = np.random.default_rng(2)
    target, normals = planes(rng)
    tree = kd_tree(target)
    T = se3.exp_se3([0.03, -0.02, 0.04, 0.01, 0.02, -0.01])
    source = planes(rng)[0]
    result = iterate(tree, normals[tree.order], source, T, limits(0.4, 1))
    np.testing.assert_allclose(
        result.T_target_source, reference_step(target, normals, source, T, 0.4), atol=1e-9
    )
    moved_points = source @ T[:3, :3].T + T[:3, 3]
    distance = np.linalg.norm(moved_points[:, None] - target, axis=2)
    row, is_near = distance.argmin(axis=1), distance.min(axis=1) < 0.4
    r = np.sum((moved_points - target[row]) * normals[row], axis=1)[is_near]
    assert result.scale_m == pytest.approx(1.4826 * np.median(np.abs(r)), rel=1e-9)
    assert (result.pairs, result.iterations, result.converged) == (is_near.sum(), 1, False)
    # The gate remains at six robust standard deviations.
    assert result.gate_m == pytest.approx(6.0 * result.scale_m, rel=1e-9)


def test_the_minimum_number_of_pairs_is_inclusive() -> None:
    rng = np.random.default_rng(3)
    target, normals = planes(rng)
    tree, T = kd_tree(target), np.eye(4)
    normals = normals[tree.order]
    enough = iterate(tree, normals, target[:50], T, limits(0.4, 1, min_pairs=50))
    assert (enough.pairs, enough.iterations) == (50, 1)
    # Exact pairs have the least scale, and the gate narrows by a fifth.
    assert enough.scale_m == 1e-9
    assert enough.gate_m == pytest.approx(0.8 * 0.4, rel=1e-12)
    too_few = iterate(tree, normals, target[:50], T, limits(0.4, 1, min_pairs=51))
    assert (too_few.pairs, too_few.iterations, too_few.gate_m, too_few.converged) == (50, 0, 0.4, False)


def test_iterations_converge_to_the_transform_and_the_gate_to_its_last_value() -> None:
    target, normals = planes(np.random.default_rng(4))
    tree = kd_tree(target)
    T_true = se3.exp_se3([0.02, -0.01, 0.03, 0.01, -0.01, 0.02])
    source = se3.transform_points(se3.inverse(T_true), target)
    result = iterate(tree, normals[tree.order], source, np.eye(4), limits(1.0, 40))
    assert result.converged
    np.testing.assert_allclose(result.T_target_source, T_true, atol=1e-5)
    assert result.gate_m >= 0.2
    assert 2 <= result.iterations < 40
