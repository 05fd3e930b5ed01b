# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gauss-Newton on the poses of a graph, damped if a full step does not reduce the cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_core.dfns.pose_graph_optimization._block_cholesky import factorise, solve
from cdff_core.dfns.pose_graph_optimization._linearisation import accumulate
from cdff_core.dfns.pose_graph_optimization._problem import Problem

#: Smallest damping other than 0, and damping above which the iteration ends.
_MIN_DAMPING, _MAX_DAMPING = 1e-6, 1e8


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Result of the minimisation: poses ``(n, 4, 4)`` and their cost."""

    poses: FloatArray
    chi2: float
    iterations: int
    converged: bool


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Gauss-Newton approximation of the cost at some poses, in the order of elimination.

    Attributes
    ----------
    diagonal, lower : ndarray, shapes (f, d, d) and (s, d, d)
        Blocks of the Hessian.
    gradient : ndarray, shape (f, d)
    """

    diagonal: FloatArray
    lower: FloatArray
    gradient: FloatArray

    @property
    def scale(self) -> FloatArray:
        """Diagonal of the Hessian ``(f, d)``, bounded from 0."""
        values = np.diagonal(self.diagonal, axis1=1, axis2=2)
        return np.maximum(values, 1e-12 * max(float(values.max(initial=0.0)), 1e-300))


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
    chi2, damping = float(weights @ problem.squared_errors(poses)), 0.0
    for iteration in range(max_iterations):
        equations = normal_equations(problem, poses, weights)
        scale = equations.scale
        if float(np.sum(equations.gradient**2 / scale)) <= tolerance * max(chi2, 1e-12):
            return Solution(poses, chi2, iteration, True)
        while True:
            moved_poses = _step(problem, poses, equations, damping * scale)
            new_chi2 = np.inf if moved_poses is None else float(weights @ problem.squared_errors(moved_poses))
            if new_chi2 <= chi2 * (1.0 + 1e-12):
                break
            if damping >= _MAX_DAMPING:
                if moved_poses is None:
                    raise DegenerateGeometryError(
                        "pose graph: the information leaves poses unconstrained, even with damping",
                        ["free_poses"],
                    )
                return Solution(poses, chi2, iteration + 1, True)
            damping = max(10.0 * damping, _MIN_DAMPING)
        damping = 0.1 * damping if damping > _MIN_DAMPING else 0.0
        assert moved_poses is not None
        has_converged = chi2 - new_chi2 <= tolerance * chi2
        poses, chi2 = moved_poses, new_chi2
        if has_converged:
            return Solution(poses, chi2, iteration + 1, True)
    return Solution(poses, chi2, max_iterations, False)


def normal_equations(problem: Problem, poses: FloatArray, weights: FloatArray) -> NormalEquations:
    """Return the normal equations at poses ``(n, 4, 4)`` for weights ``(m,)`` of the edges."""
    d, elimination = len(problem.rows), problem.elimination
    count, slots = len(problem.free), len(elimination.fronts.slot_row)
    diagonal, lower, gradient = np.zeros((count, d, d)), np.zeros((slots, d, d)), np.zeros((count, d))
    accumulate(
        poses,
        problem.vertex_a,
        problem.vertex_b,
        problem.measured,
        problem.information,
        weights,
        tuple(problem.rows.tolist()),
        problem.position,
        problem.slot,
        problem.is_a_later,
        diagonal,
        lower,
        gradient,
    )
    return NormalEquations(diagonal, lower, gradient)


def _step(
    problem: Problem, poses: FloatArray, equations: NormalEquations, damping: FloatArray
) -> FloatArray | None:
    """Return the poses after a step with damping ``(f, d)``; None if the equations are singular."""
    if not len(problem.free):
        return poses
    d = len(problem.rows)
    diagonal = equations.diagonal + damping[:, :, None] * np.eye(d)
    try:
        factors = factorise(problem.elimination.fronts, diagonal, equations.lower)
    except np.linalg.LinAlgError:  # not positive definite
        return None
    x = solve(factors, -equations.gradient.reshape(-1, 1)).reshape(-1, d)
    step = np.zeros((len(problem.free), 6))
    step[:, problem.rows] = x[problem.position[problem.free]]
    moved_poses = poses.copy()
    moved_poses[problem.free] = poses[problem.free] @ se3.exp_se3(step)
    return moved_poses if np.isfinite(moved_poses).all() else None
