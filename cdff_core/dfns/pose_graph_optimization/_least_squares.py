# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gauss-Newton on the poses of a graph, damped where a step goes too far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, diags

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_core.dfns.pose_graph_optimization._chordal import factorised
from cdff_core.dfns.pose_graph_optimization._problem import Problem

_FIRST_DAMPING = 1e-6
_MOST_DAMPING = 1e8


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Poses ``(n, 4, 4)`` with their cost and the state of the minimisation."""

    poses: FloatArray
    chi2: float
    iterations: int
    converged: bool


def minimised(
    problem: Problem, poses: FloatArray, weights: FloatArray, max_iterations: int, tolerance: float
) -> Solution:
    """Minimise ``sum weight e' Omega e`` with steps ``X Exp(x)`` of each pose.

    Levenberg-Marquardt damping (Marquardt 1963) is only active where full steps do not reduce the sum.

    Raises
    ------
    DegenerateGeometryError
        If the information leaves poses unconstrained even with damping.
    """
    chi2 = float(weights @ problem.squared(problem.errors(poses)))
    damping = 0.0
    for iteration in range(max_iterations):
        H, g = normal_equations(problem, poses, weights)
        diagonal = H.diagonal()
        scale = np.maximum(diagonal, 1e-12 * max(float(diagonal.max(initial=0.0)), 1e-300))
        if float(np.sum(g**2 / scale)) <= tolerance * max(chi2, 1e-12):
            return Solution(poses, chi2, iteration, True)
        while True:
            moved = _moved(problem, poses, H, g, damping * scale)
            lower = np.inf if moved is None else float(weights @ problem.squared(problem.errors(moved)))
            if lower <= chi2 * (1.0 + 1e-12):
                break
            if damping >= _MOST_DAMPING:
                if moved is None:
                    raise DegenerateGeometryError(
                        "pose graph: the information leaves poses unconstrained, even with damping",
                        ["free_poses"],
                    )
                return Solution(poses, chi2, iteration + 1, True)
            damping = max(10.0 * damping, _FIRST_DAMPING)
        damping = 0.1 * damping if damping > _FIRST_DAMPING else 0.0
        assert moved is not None
        done = chi2 - lower <= tolerance * chi2
        poses, chi2 = moved, lower
        if done:
            return Solution(poses, chi2, iteration + 1, True)
    return Solution(poses, chi2, max_iterations, False)


def normal_equations(
    problem: Problem, poses: FloatArray, weights: FloatArray
) -> tuple[csc_matrix, FloatArray]:
    """Return approximate Hessian and gradient by the poses that are not fixed, ``d`` rows each."""
    n, d = len(poses), len(problem.rows)
    prior = problem.is_prior
    e = problem.errors(poses)
    Jb = se3.inverse_right_jacobian_se3(e)
    # An error changes by -Ad(X_b^-1 X_a) x_a for a motion of a, and by x_b for one of b.
    Ja = -Jb @ se3.adjoint(se3.inverse(poses[problem.second]) @ poses[problem.first])
    e, Ja, Jb = e[:, problem.rows], *(J[:, problem.rows[:, None], problem.rows] for J in (Ja, Jb))
    Ja[prior] = 0.0
    W = problem.information * weights[:, None, None]
    WJa, WJb = W @ Ja, W @ Jb
    JaT, JbT = np.swapaxes(Ja, 1, 2), np.swapaxes(Jb, 1, 2)
    place = np.full(n, -1)
    free = np.setdiff1d(np.arange(n), problem.held)
    place[free] = np.arange(len(free))
    a, b = place[problem.first], place[problem.second]
    cross = JaT @ WJb
    rows, columns, values = [], [], []
    for i, j, block in (
        (a, a, JaT @ WJa),
        (b, b, JbT @ WJb),
        (a, b, cross),
        (b, a, np.swapaxes(cross, 1, 2)),
    ):
        kept = (i >= 0) & (j >= 0)
        shape = (int(kept.sum()), d, d)
        rows.append(np.broadcast_to((i[kept, None] * d + np.arange(d))[:, :, None], shape).ravel())
        columns.append(np.broadcast_to((j[kept, None] * d + np.arange(d))[:, None, :], shape).ravel())
        values.append(block[kept].ravel())
    size = len(free) * d
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    g = np.zeros((n, d))
    np.add.at(g, problem.first, np.einsum("mji,mj->mi", WJa, e))
    np.add.at(g, problem.second, np.einsum("mji,mj->mi", WJb, e))
    return coo_matrix(entries, shape=(size, size)).tocsc(), g[free].ravel()


def _moved(
    problem: Problem, poses: FloatArray, H: csc_matrix, g: FloatArray, damping: FloatArray
) -> FloatArray | None:
    """Return the poses after a step, None if the equations are singular."""
    if not len(g):
        return poses
    try:
        x = factorised(csc_matrix(H + diags(damping))).solve(-g)
    except RuntimeError:  # SuperLU: the matrix is exactly singular
        return None
    if not np.isfinite(x).all():
        return None
    d = len(problem.rows)
    step = np.zeros((len(poses), 6))
    free = np.setdiff1d(np.arange(len(poses)), problem.held)
    step[np.ix_(free, problem.rows)] = x.reshape(-1, d)
    moved = poses @ se3.exp_se3(step)
    moved[problem.held] = poses[problem.held]
    return moved
