# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Integrals of the readings of an inertial measurement unit over many intervals of time.

Between two readings, angular rate and specific force are interpolated linearly, so that an interval may start
and end at any time. All intervals are integrated together (Forster et al. 2017,
doi:10.1109/TRO.2016.2597321, equations 33 to 35, with half steps).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.geometry import se3

#: Integration steps for each reading.
_STEPS_PER_READING = 2
#: Steps of the numerical derivatives: time (s), angular rate (rad/s), specific force (m/s²).
_TIME_STEP_S, _RATE_STEP, _FORCE_STEP = 5e-4, 1e-4, 1e-3
#: Gain of the third difference of white noise: sqrt(1 + 9 + 9 + 1).
_THIRD_DIFFERENCE = np.sqrt(20.0)


class Readings(NamedTuple):
    """Times ``(n,)``, seconds, specific force ``(n, 3)``, m/s², and angular rate ``(n, 3)``, rad/s."""

    t_s: FloatArray
    force_m_s2: FloatArray
    rate_rad_s: FloatArray


class Integrals(NamedTuple):
    """Integrals over k intervals in the axes of the IMU at their starts.

    ``rotation`` is ``(k, 3, 3)``, ``velocity`` and ``position`` are ``(k, 3)``: single and double integral of
    the specific force, without gravity.
    """

    rotation: FloatArray
    velocity: FloatArray
    position: FloatArray


def integrals(readings: Readings, t_s: FloatArray, duration_s: FloatArray, bias: FloatArray) -> Integrals:
    """Return the integrals over intervals.

    Parameters
    ----------
    readings : Readings
    t_s, duration_s : ndarray, shape (k,)
        Starts in the clock of the IMU, and durations.
    bias : ndarray, shape (6,)
        Of angular rate (rad/s) and specific force (m/s²); it is subtracted.
    """
    period_s = float(np.median(np.diff(readings.t_s)))
    steps = max(4, int(np.ceil(_STEPS_PER_READING * float(duration_s.max()) / period_s)))
    at = t_s[:, None] + duration_s[:, None] * ((np.arange(steps) + 0.5) / steps)
    rate, force = (
        np.stack([np.interp(at, readings.t_s, column) for column in values.T], axis=-1) - own
        for values, own in ((readings.rate_rad_s, bias[:3]), (readings.force_m_s2, bias[3:]))
    )
    step_s = (duration_s / steps)[:, None]
    half_rotations = se3.exp_so3(0.5 * rate * step_s[:, :, None])
    R = np.tile(np.eye(3), (len(t_s), 1, 1))
    velocity, position = np.zeros((len(t_s), 3)), np.zeros((len(t_s), 3))
    for k in range(steps):
        R_middle = R @ half_rotations[:, k]
        acceleration = (R_middle @ force[:, k, :, None])[..., 0]
        position += step_s * velocity + 0.5 * step_s**2 * acceleration
        velocity += step_s * acceleration
        R = R_middle @ half_rotations[:, k]
    return Integrals(R, velocity, position)


def derivatives(readings: Readings, t_s: FloatArray, duration_s: FloatArray, bias: FloatArray) -> FloatArray:
    """Return derivatives ``(k, 9, 7)`` of rotation, velocity and position by start time and bias.

    The arguments are those of ``integrals``. Rows are in rad, m/s and m; columns are per second, rad/s and
    m/s². A rotation R becomes ``R Exp(d h)`` with its derivative d and a small change h.
    """
    columns = []
    centre = integrals(readings, t_s, duration_s, bias)
    for k in range(7):
        step = [_TIME_STEP_S, *[_RATE_STEP] * 3, *[_FORCE_STEP] * 3][k]
        sides = []
        for sign in (1.0, -1.0):
            moved = bias.copy()
            if k:
                moved[k - 1] += sign * step
            start = t_s + (0.0 if k else sign * step)
            side = integrals(readings, start, duration_s, moved)
            rotation = se3.log_so3(np.swapaxes(centre.rotation, 1, 2) @ side.rotation)
            sides.append(np.concatenate([rotation, side.velocity, side.position], axis=1))
        columns.append((sides[0] - sides[1]) / (2.0 * step))
    return np.stack(columns, axis=-1)


def has_readings(readings: Readings, t_s: FloatArray, duration_s: FloatArray, gap_s: float) -> BoolArray:
    """Return a mask ``(k,)`` of the intervals that have readings throughout, without gaps above ``gap_s``.

    ``t_s`` and ``duration_s`` are those of ``integrals``.
    """
    first = np.searchsorted(readings.t_s, t_s, side="right") - 1
    last = np.searchsorted(readings.t_s, t_s + duration_s, side="left")
    is_inside = (first >= 0) & (last < len(readings.t_s))
    gaps = np.concatenate([[0], np.cumsum(np.diff(readings.t_s) > gap_s)])
    first, last = np.clip(first, 0, len(gaps) - 1), np.clip(last, 0, len(gaps) - 1)
    return np.asarray(is_inside & (gaps[last] == gaps[first]))


def noise_densities(readings: Readings) -> FloatArray:
    """Return the noise of angular rate (rad/s/√Hz) and specific force (m/s²/√Hz) of the readings, ``(2,)``.

    Third differences of successive readings contain little of a smooth motion; vibrations count as noise.
    """
    period_s = float(np.median(np.diff(readings.t_s)))
    sigmas = [
        max(1.4826 * float(np.median(np.abs(d))) for d in np.diff(values, n=3, axis=0).T) / _THIRD_DIFFERENCE
        for values in (readings.rate_rad_s, readings.force_m_s2)
    ]
    return np.asarray(np.array(sigmas) * np.sqrt(period_s), np.float64)
