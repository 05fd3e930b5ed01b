# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled Kalman filters that whiten the residuals of a fit whose reference drifts."""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray


@njit(cache=True)
def whiten(
    columns: FloatArray,
    covariances: FloatArray,
    intervals_s: FloatArray,
    initial: FloatArray,
    intensity: float,
    order: int,
    out: FloatArray,
    state: FloatArray,
    covariance: FloatArray,
) -> float:  # pragma: no cover - compiled
    """Filter the columns of a linear model and return the sum of the logarithms of the determinants.

    The measurement k is ``columns[k]`` (3, m) = H state + noise. The state of each axis is a position
    (order 1), or a position and a velocity (order 2), whose last element is a random walk of the given
    intensity.

    Parameters
    ----------
    columns : ndarray (n, 3, m)
        Residual and derivatives.
    covariances : ndarray (n, 3, 3)
        Of the noise.
    intervals_s : ndarray (n,)
        Time since the previous measurement.
    initial : ndarray (3 * order, 3 * order)
        Covariance of the state before the first measurement.
    out : ndarray (n, 3, m)
        Innovations divided by the lower Cholesky factor of their covariance.
    state, covariance : ndarray (3 * order, m), (3 * order, 3 * order)
        After the last measurement.
    """
    n, _, m = columns.shape
    d = 3 * order
    state[:] = 0.0
    covariance[:] = initial
    logarithms = 0.0
    gain = np.empty((d, 3))
    for k in range(n):
        dt = intervals_s[k]
        if dt > 0.0:
            _predict(state, covariance, dt, intensity, order)
        S = covariance[:3, :3] + covariances[k]
        L = np.linalg.cholesky(S)
        innovation = columns[k] - state[:3]
        for j in range(m):
            for i in range(3):
                value = innovation[i, j]
                for column in range(i):
                    value -= L[i, column] * out[k, column, j]
                out[k, i, j] = value / L[i, i]
        for i in range(3):
            logarithms += 2.0 * np.log(L[i, i])
        gain[:] = np.linalg.solve(S, np.ascontiguousarray(covariance[:3, :])).T
        state += gain @ innovation
        covariance -= gain @ np.ascontiguousarray(covariance[:3, :])
        for i in range(d):
            for j in range(i):
                mean = 0.5 * (covariance[i, j] + covariance[j, i])
                covariance[i, j], covariance[j, i] = mean, mean
    return logarithms


@njit(cache=True)
def _predict(
    state: FloatArray, covariance: FloatArray, dt: float, intensity: float, order: int
) -> None:  # pragma: no cover - compiled
    """Propagate the state ``(3 order, m)`` and covariance of the drift over ``dt`` (s), in place.

    With ``order`` 1 the drift is a random walk. With ``order`` 2 its rate is a random walk, and the state is
    the drift and its rate. ``intensity`` is the variance that the walk gains per second.
    """
    if order == 1:
        for i in range(3):
            covariance[i, i] += intensity * dt
        return
    state[:3] += dt * state[3:]
    cross = covariance[:3, 3:].copy()
    covariance[:3, :3] += dt * (cross + cross.T) + dt * dt * covariance[3:, 3:]
    covariance[:3, 3:] += dt * covariance[3:, 3:]
    covariance[3:, :3] = covariance[:3, 3:].T
    for i in range(3):
        covariance[i, i] += intensity * dt**3 / 3.0
        covariance[i, 3 + i] += intensity * dt**2 / 2.0
        covariance[3 + i, i] += intensity * dt**2 / 2.0
        covariance[3 + i, 3 + i] += intensity * dt
