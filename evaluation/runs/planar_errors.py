# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Dead reckoning in the plane: reference methods without a filter, and errors after the best alignment."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Sample

IntArray = np.ndarray


def wheel_positions(wheels: list[Sample]) -> FloatArray:
    """Return the positions (n, 2) of wheel odometry, metres."""
    return np.array([s.value.transform.matrix[:2, 3] for s in wheels])


def speed_and_gyro(
    t_s: FloatArray, speed_m_s: FloatArray, gyro_t_s: FloatArray, rate_rad_s: FloatArray
) -> FloatArray:
    """Return positions (n, 2) by the wheels' speed, integrated along the heading of the gyro.

    ``rate_rad_s`` (m,) is the rate about the vertical at the times ``gyro_t_s``. Trapezoidal rule.
    """
    heading_at_readings = _integral(gyro_t_s, rate_rad_s)
    heading = np.interp(t_s, gyro_t_s, heading_at_readings)
    return np.column_stack([_integral(t_s, speed_m_s * f(heading)) for f in (np.cos, np.sin)])


def _integral(t_s: FloatArray, values: FloatArray) -> FloatArray:
    steps = 0.5 * np.diff(t_s) * (values[1:] + values[:-1])
    return np.concatenate([[0.0], np.cumsum(steps)])


def aligned_error_m(positions: FloatArray, truth: FloatArray) -> float:
    """Return the RMS distance of positions (n, 2) from true ones after the best rotation and translation."""
    centred, centred_truth = positions - positions.mean(axis=0), truth - truth.mean(axis=0)
    z = np.sum((centred_truth[:, 0] + 1j * centred_truth[:, 1]) * (centred[:, 0] - 1j * centred[:, 1]))
    rotated = (centred[:, 0] + 1j * centred[:, 1]) * (z / abs(z))
    return float(np.sqrt(np.mean(np.abs(centred_truth[:, 0] + 1j * centred_truth[:, 1] - rotated) ** 2)))
