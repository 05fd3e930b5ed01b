# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Strapdown integration, compiled because numpy's call overhead dominates for few readings."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray


@njit(cache=True)
def strapdown(
    t_s: FloatArray, readings: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Integrate inertial readings by the trapezoidal rule in the body frame at the start, with coning to
    second order.

    Parameters
    ----------
    t_s : ndarray, shape (k,)
        Ascending times from the start (0) to the end of the interval, s.
    readings : ndarray, shape (k, 6)
        Angular rates, rad/s, and specific forces, m/s^2, at these times, without biases.

    Returns
    -------
    rotation, rotation_integral : ndarray, shape (3, 3)
        R_start_end, and the integral of the rotation over the interval, s.
    dv, dp : ndarray, shape (3,)
        Integral and double integral of the specific force in the frame of the start, m/s and m.
    """
    total, coning, angle, step = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    R, R_next, rotation_integral = np.eye(3), np.eye(3), np.zeros((3, 3))
    force, dv, dp = readings[0, 3:].copy(), np.zeros(3), np.zeros(3)
    for k in range(1, len(t_s)):
        dt = t_s[k] - t_s[k - 1]
        for i in range(3):
            step[i] = 0.5 * dt * (readings[k - 1, i] + readings[k, i])
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            coning[i] += 0.5 * (total[j] * step[m] - total[m] * step[j])
        for i in range(3):
            total[i] += step[i]
            angle[i] = total[i] + coning[i]
        _set_rotation(angle, R_next)
        for i in range(3):
            force_next = (
                R_next[i, 0] * readings[k, 3] + R_next[i, 1] * readings[k, 4] + R_next[i, 2] * readings[k, 5]
            )
            dv_step = 0.5 * dt * (force[i] + force_next)
            force[i] = force_next
            dp[i] += dt * (dv[i] + 0.5 * dv_step)
            dv[i] += dv_step
            for j in range(3):
                rotation_integral[i, j] += 0.5 * dt * (R[i, j] + R_next[i, j])
                R[i, j] = R_next[i, j]
    return R, rotation_integral, dv, dp


@njit(cache=True)
def _set_rotation(a: FloatArray, R: FloatArray) -> None:  # pragma: no cover - compiled
    """Set ``R`` to the rotation matrix of the rotation vector ``a`` (Rodrigues' formula)."""
    x, y, z = a
    half = 0.5 * math.sqrt(x * x + y * y + z * z) + 1e-300
    s, c = math.sin(2.0 * half) / (2.0 * half), 0.5 * (math.sin(half) / half) ** 2
    R[0, 0], R[1, 1], R[2, 2] = (
        1.0 - c * (y * y + z * z),
        1.0 - c * (x * x + z * z),
        1.0 - c * (x * x + y * y),
    )
    R[0, 1], R[1, 0] = c * x * y - s * z, c * x * y + s * z
    R[0, 2], R[2, 0] = c * x * z + s * y, c * x * z - s * y
    R[1, 2], R[2, 1] = c * y * z - s * x, c * y * z + s * x
