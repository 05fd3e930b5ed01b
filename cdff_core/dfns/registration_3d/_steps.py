# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled steps of the registrations: Gauss-Newton step, its extrapolation, and convergence.

A step (6,) is a translation and a rotation about a centre times a radius, metres.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray

#: Largest length of a cycle of repeating pairs that is detected, iterations.
_LONGEST_CYCLE = 4
#: Ratio of successive steps above which convergence is slow, and largest factor on a step.
_SLOW, _LONGEST_STEP = 0.25, 6.0


@njit(cache=True)
def newton_step(H: FloatArray, g: FloatArray) -> FloatArray:  # pragma: no cover - compiled
    """Return the Gauss-Newton step (6,); damping avoids singular equations along unconstrained directions."""
    return -np.linalg.solve(H + 1e-6 * max(np.trace(H), 1e-12) * np.eye(6), g)


@njit(cache=True)
def moved_by(
    T_target_source: FloatArray, step: FloatArray, centre: FloatArray, radius: float
) -> FloatArray:  # pragma: no cover - compiled
    """Return ``T_target_source`` after a step (6,) in axes of the target.

    Rounding errors of the rotation are not corrected.
    """
    phi = step[3:] / radius
    half = 0.5 * np.sqrt(np.sum(phi * phi)) + 1e-150
    K = np.array([[0.0, -phi[2], phi[1]], [phi[2], 0.0, -phi[0]], [-phi[1], phi[0], 0.0]])
    R = np.eye(3) + np.sin(2.0 * half) / (2.0 * half) * K + 0.5 * (np.sin(half) / half) ** 2 * (K @ K)
    motion = np.eye(4)
    motion[:3, :3] = R
    motion[:3, 3] = step[:3] + centre - R @ centre
    return motion @ T_target_source


@njit(cache=True)
def step_length(steps: FloatArray, was_extended: bool) -> float:  # pragma: no cover - compiled
    """Return the factor on the last of the steps (k, 6) that replaces further steps in its direction.

    Where surfaces slide along each other, steps form a geometric sequence whose sum is ``1 / (1 - ratio)``
    times the first step (Aitken's extrapolation; Besl and McKay 1992, doi:10.1109/34.121791, extrapolate
    ICP). After an extended step (``was_extended``) the ratio is unknown and the factor is 1.
    """
    if was_extended or len(steps) < 2:
        return 1.0
    ratio = np.sum(steps[-1] * steps[-2]) / max(np.sum(steps[-2] ** 2), 1e-300)
    return min(1.0 / (1.0 - ratio), _LONGEST_STEP) if _SLOW <= ratio < 1.0 else 1.0


@njit(cache=True)
def has_converged(steps: FloatArray, tolerance_m: float) -> bool:  # pragma: no cover - compiled
    """Return whether the last of the steps (k, 6), or the sum of the last few (pairs that repeat in a cycle),
    is below the tolerance.
    """
    total = np.zeros(6)
    for count in range(1, min(_LONGEST_CYCLE, len(steps)) + 1):
        total += steps[-count]
        if np.sqrt(np.sum(total[:3] ** 2)) + np.sqrt(np.sum(total[3:] ** 2)) < tolerance_m:
            return True
    return False
