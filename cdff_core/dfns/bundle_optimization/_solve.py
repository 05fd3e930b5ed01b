# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Levenberg-Marquardt with the points eliminated, or the poses where the points are far fewer.

References
----------
.. [1] B. Triggs et al., Bundle Adjustment - A Modern Synthesis, 2000, doi:10.1007/3-540-44480-7_21, §6
.. [2] K. Madsen, H. Nielsen, O. Tingleff, Methods for Non-Linear Least Squares Problems, 2004, §3.2:
  damping
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from cdff_common.arrays import FloatArray
from cdff_core.dfns.bundle_optimization import _poses_first
from cdff_core.dfns.bundle_optimization._kernels import point_steps
from cdff_core.dfns.bundle_optimization._system import Estimate, NormalEquations, System

_INITIAL_DAMPING, _MAX_DAMPING = 1e-4, 1e32
#: Ratio to the initial cost at which a cost is 0 up to rounding; a problem with as many unknowns as residuals
#: has the cost 0.
_ZERO_COST_RATIO = 1e-16


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Result of the minimisation.

    Attributes
    ----------
    residuals, weights : ndarray, shape (m, 3), (m,)
        Final residuals in pixels and weights of the observations, in the order of the system.
    cost_initial, cost_final : float
        Half the sum of squared residuals, without robust loss and prior.
    robust_initial, robust_final : float
        Minimised cost: with robust loss and prior.
    behind : int
        Number of observations of points behind their camera.
    """

    estimate: Estimate
    residuals: FloatArray
    weights: FloatArray
    cost_initial: float
    cost_final: float
    robust_initial: float
    robust_final: float
    behind: int
    iterations: int
    converged: bool


def minimise(system: System, initial_estimate: Estimate, max_iterations: int, tolerance: float) -> Solution:
    """Minimise the cost [1]_ from an initial estimate with the damping of [2]_."""
    estimate, current = initial_estimate, system.residuals(initial_estimate)
    initial = current
    damping, growth, iterations, converged = _INITIAL_DAMPING, 2.0, 0, False
    normal = system.normal(estimate, current.residuals, current.weights)
    compute_step = _poses_first.compute_step if _poses_first.is_cheaper(system) else _points_first_step
    while iterations < max_iterations and not converged:
        iterations += 1
        step, point_step = compute_step(system, normal, damping)
        if step is not None:
            candidate = system.apply_step(estimate, step, point_step)
            evaluated = system.residuals(candidate)
            predicted_decrease = _predicted_decrease(normal, step, point_step, damping)
            decrease = current.minimised_cost - evaluated.minimised_cost
            if np.isfinite(evaluated.minimised_cost) and decrease > 0.0 and 0.0 < predicted_decrease < np.inf:
                converged = (
                    decrease <= tolerance * current.minimised_cost
                    or evaluated.minimised_cost <= _ZERO_COST_RATIO * initial.minimised_cost
                )
                estimate, current = candidate, evaluated
                gain_ratio = decrease / predicted_decrease
                damping, growth = damping * max(1.0 / 3.0, 1.0 - (2.0 * gain_ratio - 1.0) ** 3), 2.0
                if not converged:
                    normal = system.normal(estimate, current.residuals, current.weights)
                continue
            if 0.0 <= predicted_decrease <= tolerance * current.minimised_cost:
                converged = True  # the model predicts no decrease
                continue
        damping, growth = damping * growth, 2.0 * growth
        if damping > _MAX_DAMPING:
            break
    return Solution(
        estimate=estimate,
        residuals=current.residuals,
        weights=current.weights,
        cost_initial=initial.plain_cost,
        cost_final=current.plain_cost,
        robust_initial=initial.minimised_cost,
        robust_final=current.minimised_cost,
        behind=current.behind,
        iterations=iterations,
        converged=converged,
    )


def _points_first_step(
    system: System, normal: NormalEquations, damping: float
) -> tuple[FloatArray | None, FloatArray]:
    """Return the steps of cameras and lenses, and of points ``(p, 3)``; None if the system is singular."""
    S, b, inverses, _ = system.eliminate_points(normal, damping)
    step = np.zeros(0)
    if system.size:
        try:
            step = -cho_solve(
                cho_factor(S, lower=True, overwrite_a=True, check_finite=False), b, check_finite=False
            )
        except LinAlgError:
            return None, step
        if not np.isfinite(step).all():
            return None, step
    point_step = point_steps(
        system.start, system.cam, system.columns, system.count, normal.gp, normal.W, inverses, step
    )
    return step, point_step


def _predicted_decrease(
    normal: NormalEquations, step: FloatArray, point_step: FloatArray, damping: float
) -> float:
    """Return the decrease of the cost predicted by the quadratic model, half of ``damping d'Dd - g'd``.

    d is the whole step, g the gradient and D the diagonal of the normal matrix.
    """
    D = np.clip(np.diag(normal.H), 1e-6, 1e32)
    Dp = np.clip(np.diagonal(normal.Hp, axis1=1, axis2=2), 1e-6, 1e32)
    damping_term = damping * (float(step**2 @ D) + float((point_step**2 * Dp).sum()))
    return 0.5 * (damping_term - float(normal.g @ step) - float((normal.gp * point_step).sum()))
