# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gauss-Newton on the poses of a graph, damped if a full step does not reduce the cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, diags

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_core.dfns.pose_graph_optimization._chordal import factorise
from cdff_core.dfns.pose_graph_optimization._problem import Problem

_MIN_DAMPING, _MAX_DAMPING = 1e-6, 1e8


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Result of the minimisation: poses ``(n, 4, 4)`` and their cost."""

    poses: FloatArray
    chi2: float
    iterations: int
    converged: bool


def minimise(
    problem: Problem, poses: FloatArray, weights: FloatArray, max_iterations: int, tolerance: float
) -> Solution:
    """Minimise ``sum weight e' Omega e`` by steps ``X Exp(x)`` of each pose that is not fixed.

    Levenberg-Marquardt damping (Marquardt 1963) is only active if full steps do not reduce the sum.

    Raises
    ------
    DegenerateGeometryError
        If the information leaves poses unconstrained even with damping.
    """
    chi2 = float(weights @ problem.squared_errors(problem.errors(poses)))
    damping = 0.0
    for iteration in range(max_iterations):
        H, g = normal_equations(problem, poses, weights)
        diagonal = H.diagonal()
        scale = np.maximum(diagonal, 1e-12 * max(float(diagonal.max(initial=0.0)), 1e-300))
        if float(np.sum(g**2 / scale)) <= tolerance * max(chi2, 1e-12):
            return Solution(poses, chi2, iteration, True)
        while True:
            moved = _step(problem, poses, H, g, damping * scale)
            new_chi2 = (
                np.inf if moved is None else float(weights @ problem.squared_errors(problem.errors(moved)))
            )
            if new_chi2 <= chi2 * (1.0 + 1e-12):
                break
            if damping >= _MAX_DAMPING:
                if moved is None:
                    raise DegenerateGeometryError(
                        "pose graph: the information leaves poses unconstrained, even with damping",
                        ["free_poses"],
                    )
                return Solution(poses, chi2, iteration + 1, True)
            damping = max(10.0 * damping, _MIN_DAMPING)
        damping = 0.1 * damping if damping > _MIN_DAMPING else 0.0
        assert moved is not None
        has_converged = chi2 - new_chi2 <= tolerance * chi2
        poses, chi2 = moved, new_chi2
        if has_converged:
            return Solution(poses, chi2, iteration + 1, True)
    return Solution(poses, chi2, max_iterations, False)


def normal_equations(
    problem: Problem, poses: FloatArray, weights: FloatArray
) -> tuple[csc_matrix, FloatArray]:
    """Return the Gauss-Newton Hessian and the gradient with respect to the poses that are not fixed, ``d``
    rows for each pose.
    """
    n, d = len(poses), len(problem.rows)
    prior = problem.is_prior
    e = problem.errors(poses)
    Jb = se3.inverse_right_jacobian_se3(e)
    # An error changes by -Ad(X_b^-1 X_a) x_a for a step x_a of pose a, and by x_b for a step of pose b.
    Ja = -Jb @ se3.adjoint(se3.inverse(poses[problem.vertex_b]) @ poses[problem.vertex_a])
    e, Ja, Jb = e[:, problem.rows], *(J[:, problem.rows[:, None], problem.rows] for J in (Ja, Jb))
    Ja[prior] = 0.0
    W = problem.information * weights[:, None, None]
    WJa, WJb = W @ Ja, W @ Jb
    JaT, JbT = np.swapaxes(Ja, 1, 2), np.swapaxes(Jb, 1, 2)
    unknown = np.full(n, -1)  # row of each pose among those that are not fixed, -1 for a fixed one
    free = np.setdiff1d(np.arange(n), problem.fixed)
    unknown[free] = np.arange(len(free))
    a, b = unknown[problem.vertex_a], unknown[problem.vertex_b]
    cross = JaT @ WJb
    rows, columns, values = [], [], []
    for i, j, block in (
        (a, a, JaT @ WJa),
        (b, b, JbT @ WJb),
        (a, b, cross),
        (b, a, np.swapaxes(cross, 1, 2)),
    ):
        both_free = (i >= 0) & (j >= 0)
        shape = (int(both_free.sum()), d, d)
        rows.append(np.broadcast_to((i[both_free, None] * d + np.arange(d))[:, :, None], shape).ravel())
        columns.append(np.broadcast_to((j[both_free, None] * d + np.arange(d))[:, None, :], shape).ravel())
        values.append(block[both_free].ravel())
    size = len(free) * d
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    g = np.zeros((n, d))
    np.add.at(g, problem.vertex_a, np.einsum("mji,mj->mi", WJa, e))
    np.add.at(g, problem.vertex_b, np.einsum("mji,mj->mi", WJb, e))
    return coo_matrix(entries, shape=(size, size)).tocsc(), g[free].ravel()


def _step(
    problem: Problem, poses: FloatArray, H: csc_matrix, g: FloatArray, damping: FloatArray
) -> FloatArray | None:
    """Return the poses after a step; None if the equations are singular."""
    if not len(g):
        return poses
    try:
        x = factorise(csc_matrix(H + diags(damping))).solve(-g)
    except RuntimeError:  # SuperLU: the matrix is exactly singular
        return None
    if not np.isfinite(x).all():
        return None
    d = len(problem.rows)
    step = np.zeros((len(poses), 6))
    free = np.setdiff1d(np.arange(len(poses)), problem.fixed)
    step[np.ix_(free, problem.rows)] = x.reshape(-1, d)
    moved = poses @ se3.exp_se3(step)
    moved[problem.fixed] = poses[problem.fixed]
    return moved
