# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Levenberg-Marquardt on the reduced system of the cameras, or of the points where these are far fewer.

References
----------
.. [1] B. Triggs et al., Bundle Adjustment - A Modern Synthesis, 2000, doi:10.1007/3-540-44480-7_21, §6
.. [2] K. Madsen, H. Nielsen, O. Tingleff, Methods for Non-Linear Least Squares Problems, 2004, §3.2: the
  damping
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from cdff_common.arrays import FloatArray
from cdff_core.dfns.bundle_optimization import _poses_first
from cdff_core.dfns.bundle_optimization._kernels import point_steps
from cdff_core.dfns.bundle_optimization._system import Estimate, Normal, System

_FIRST_DAMPING, _MOST_DAMPING = 1e-4, 1e32
#: Ratio to the initial cost that is rounding noise: the cost of a problem with as many unknowns as residuals
#: is 0.
_NOTHING = 1e-16


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Result of the minimisation.

    Attributes
    ----------
    cost_initial, cost_final : float
        Half the sum of squared residuals, without robust loss and prior.
    robust_initial, robust_final : float
        Minimised cost: with robust loss and prior.
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


def minimised(system: System, first: Estimate, max_iterations: int, tolerance: float) -> Solution:
    """Minimise the cost [1]_ from an initial estimate with the damping of [2]_."""
    at = first
    r, weights, robust, plain, behind = system.residuals(at)
    initial = plain, robust
    damping, growth, iterations, converged = _FIRST_DAMPING, 2.0, 0, False
    normal = system.normal(at, r, weights)
    stepped = _poses_first.stepped if _poses_first.is_smaller(system) else _points_first
    while iterations < max_iterations and not converged:
        iterations += 1
        step, point_step = stepped(system, normal, damping)
        if step is not None:
            tried = system.moved(at, step, point_step)
            r_, weights_, robust_, plain_, behind_ = system.residuals(tried)
            expected = _expected(normal, step, point_step, damping)
            if np.isfinite(robust_) and robust_ < robust and np.isfinite(expected) and expected > 0.0:
                converged = robust - robust_ <= tolerance * robust or robust_ <= _NOTHING * initial[1]
                share = (robust - robust_) / expected
                at, r, weights, robust, plain, behind = tried, r_, weights_, robust_, plain_, behind_
                damping, growth = damping * max(1.0 / 3.0, 1.0 - (2.0 * share - 1.0) ** 3), 2.0
                if not converged:
                    normal = system.normal(at, r, weights)
                continue
            if 0.0 <= expected <= tolerance * robust:
                converged = True  # the model predicts no decrease
                continue
        damping, growth = damping * growth, 2.0 * growth
        if damping > _MOST_DAMPING:
            break
    return Solution(at, r, weights, initial[0], plain, initial[1], robust, behind, iterations, converged)


def _points_first(system: System, normal: Normal, damping: float) -> tuple[FloatArray | None, FloatArray]:
    """Return the steps of cameras and lenses, and of points; None if singular."""
    S, b, inverses, _ = system.reduced(normal, damping)
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
    points = point_steps(
        system.start, system.cam, system.columns, system.count, normal.gp, normal.W, inverses, step
    )
    return step, points


def _expected(normal: Normal, step: FloatArray, point_step: FloatArray, damping: float) -> float:
    """Return the decrease predicted by the quadratic model: half of ``damping d'Dd - g'd``."""
    D = np.clip(np.diag(normal.H), 1e-6, 1e32)
    Dp = np.clip(np.diagonal(normal.Hp, axis1=1, axis2=2), 1e-6, 1e32)
    held = damping * (float(step**2 @ D) + float((point_step**2 * Dp).sum()))
    return 0.5 * (held - float(normal.g @ step) - float((normal.gp * point_step).sum()))
