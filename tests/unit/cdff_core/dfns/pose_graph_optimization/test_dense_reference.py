# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The optimiser's steps, weights and covariances agree with dense matrices and finite differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.robust import chi_squared_quantile, truncated_weights
from cdff_common.interfaces.registry import Registry
from cdff_common.types import PoseGraph
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE, ODOMETRY, PRIOR
from cdff_core.dfns.pose_graph_optimization._least_squares import _step, minimise, normal_equations
from cdff_core.dfns.pose_graph_optimization._problem import make_problem
from cdff_core.dfns.pose_graph_optimization.chordal_gauss_newton import ChordalGaussNewtonConfig
from cdff_core.dfns.pose_graph_optimization.interface import PoseGraphOptimizationInputs

Float = NDArray[np.float64]
ENDS = [(0, 1), (1, 2), (2, 3), (3, 4), (0, 2), (4, 1), (3, 0), (3, 3)]
KINDS = [ODOMETRY] * 4 + [LOOP_CLOSURE] * 3 + [PRIOR]
WEIGHTS = np.array([1.0, 0.5, 2.0, 1.0, 0.25, 3.0, 1.0, 1.5])


def make_graph(seed: int, noise: float, planar: bool = False) -> PoseGraph:
    """Return a graph of five poses, the first one fixed, with loops in both directions and a prior."""
    rng = np.random.default_rng(seed)
    mask = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0]) if planar else np.ones(6)
    poses = se3.exp_se3(rng.normal(size=(5, 6)) * mask)
    exact = [poses[a] if a == b else se3.inverse(poses[a]) @ poses[b] for a, b in ENDS]
    measured = np.array(exact) @ se3.exp_se3(noise * rng.normal(size=(len(ENDS), 6)) * mask)
    root = rng.normal(size=(len(ENDS), 6, 6)) + 2.0 * np.eye(6)
    information = (root @ np.swapaxes(root, 1, 2)) * np.outer(mask, mask)
    is_fixed = [True] + [False] * 4
    return PoseGraph.from_arrays(
        range(5), [0] * 5, poses, ENDS, measured, information, KINDS, frame="map", fixed=is_fixed
    )


def residuals(graph: PoseGraph, poses: Float) -> Float:
    """Return ``sqrt(w) L' e`` of all edges, stacked; the information of a message is in the axes of a."""
    out = []
    for k, (a, b) in enumerate(ENDS):
        Z = graph.edges.matrices[k]
        between = poses[a] if a == b else np.linalg.inv(poses[a]) @ poses[b]
        e = se3.log_se3(np.linalg.inv(Z) @ between)
        in_a = np.concatenate([Z[:3, :3] @ e[:3], Z[:3, :3] @ e[3:]])
        values, vectors = np.linalg.eigh(graph.edges.information_matrices[k])
        out.append(np.sqrt(WEIGHTS[k] * np.maximum(values, 0.0)) * (vectors.T @ in_a))
    return np.concatenate(out)


def moved(poses: Float, x: Float) -> Float:
    """Return the poses after the steps (24,) of the last four."""
    out = poses.copy()
    out[1:] = poses[1:] @ se3.exp_se3(x.reshape(4, 6))
    return out


def dense_system(graph: PoseGraph, planar: bool) -> tuple[Float, Float, Float]:
    """Return Hessian, gradient, and the columns of the unknowns, by central differences of the residuals."""
    poses, h = graph.vertices.matrices, 1e-6
    columns = [
        residuals(graph, moved(poses, h * u)) - residuals(graph, moved(poses, -h * u)) for u in np.eye(24)
    ]
    J = np.stack(columns, axis=1) / (2.0 * h)
    used_rows = np.array([6 * i + r for i in range(4) for r in ((0, 1, 5) if planar else range(6))])
    J = J[:, used_rows]
    return J.T @ J, J.T @ residuals(graph, poses), used_rows


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_a_step_solves_the_dense_damped_normal_equations(planar: bool, damping: float) -> None:
    graph = make_graph(seed=1, noise=0.1, planar=planar)
    problem, poses = make_problem(graph), graph.vertices.matrices
    assert problem.rows.tolist() == ([0, 1, 5] if planar else [0, 1, 2, 3, 4, 5])
    H, g, used_rows = dense_system(graph, planar)
    equations = normal_equations(problem, poses, WEIGHTS)
    d = len(problem.rows)
    at = problem.position[1:]
    np.testing.assert_allclose(equations.gradient[at].ravel(), g, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(equations.scale[at].ravel(), np.diag(H), rtol=1e-6)
    x = np.zeros(24)
    x[used_rows] = np.linalg.solve(H + damping * np.diag(np.diag(H)), -g)
    step = _step(problem, poses, equations, damping * equations.scale)
    assert step is not None
    np.testing.assert_allclose(step, moved(poses, x), atol=1e-6)
    assert equations.diagonal.shape == (4, d, d)


def test_the_cost_is_the_weighted_sum_and_one_iteration_is_a_full_step() -> None:
    graph = make_graph(seed=2, noise=0.02)
    problem, poses = make_problem(graph), graph.vertices.matrices
    r = residuals(graph, poses)
    assert WEIGHTS @ problem.squared_errors(poses) == pytest.approx(r @ r, rel=1e-9)
    H, g, _ = dense_system(graph, planar=False)
    solution = minimise(problem, poses, WEIGHTS, 1, 0.0)
    expected = moved(poses, np.linalg.solve(H, -g))
    np.testing.assert_allclose(solution.poses, expected, atol=1e-6)
    r = residuals(graph, expected)
    assert solution.chi2 == pytest.approx(r @ r, rel=1e-6)
    assert (solution.iterations, solution.converged) == (1, False)


def test_the_iterations_of_a_converged_solution_are_those_that_it_needs() -> None:
    graph = make_graph(seed=2, noise=0.02)
    problem, poses = make_problem(graph), graph.vertices.matrices
    solution = minimise(problem, poses, WEIGHTS, 100, 0.0)
    assert solution.converged
    assert solution.iterations < 100
    needed = minimise(problem, poses, WEIGHTS, solution.iterations, 0.0)
    assert needed.converged
    np.testing.assert_array_equal(needed.poses, solution.poses)
    assert not minimise(problem, poses, WEIGHTS, solution.iterations - 1, 0.0).converged


def solve(graph: PoseGraph, **config: Any) -> Any:
    node = Registry.default().make_dfn("pose_graph_optimization")
    node.configure(config)
    return node.process(PoseGraphOptimizationInputs(graph=graph, wanted=np.arange(5)))


def test_covariances_are_blocks_of_the_dense_inverse_in_axes_of_the_map(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(globals(), "WEIGHTS", np.ones(len(ENDS)))
    out = solve(make_graph(seed=3, noise=0.01))
    assert out.converged
    H, g, _ = dense_system(out.graph, planar=False)
    np.testing.assert_allclose(g, 0.0, atol=1e-4)
    inverse = np.linalg.inv(H)
    np.testing.assert_array_equal(out.covariances[0], np.zeros((6, 6)))
    for i in range(4):
        R = np.kron(np.eye(2), out.graph.vertices.matrices[i + 1][:3, :3])
        expected = R @ inverse[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] @ R.T
        np.testing.assert_allclose(out.covariances[i + 1], expected, rtol=1e-4, atol=1e-6)


def test_robust_weights_are_one_up_to_the_quantile_and_zero_beyond() -> None:
    limit = chi_squared_quantile(0.999, 6)
    assert limit == pytest.approx(22.4577, abs=1e-4)  # table of the chi-squared distribution
    for mu in (0.01, 1.0, 30.0):
        low, high = mu / (mu + 1.0) * limit, (mu + 1.0) / mu * limit
        middle = np.sqrt(low * high)
        np.testing.assert_allclose(
            truncated_weights(np.array([0.0, low, middle, high, 2.0 * high]), limit, mu),
            [1.0, 1.0, np.sqrt(limit * mu * (mu + 1.0) / middle) - mu, 0.0, 0.0],
            atol=1e-12,
        )


def test_the_defaults_are_those_of_least_squares_without_rejection() -> None:
    assert ChordalGaussNewtonConfig().model_dump() == {
        "initialise": "auto",
        "robust": "none",
        "inlier_probability": 0.999,
        "max_iterations": 100,
        "tolerance": 1e-8,
    }
