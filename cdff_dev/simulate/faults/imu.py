# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faults of an IMU: vibration, a bias that changes while it warms up, misalignment and scale."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import StrictModel


class Vibration(StrictModel):
    """Vibration of the moving chassis: harmonics of the rate at which grousers meet the ground.

    The amplitude is proportional to the speed. The IMU has no anti-aliasing filter: frequencies above half
    its rate are aliased.

    Source: narrow-band vibration of rotating parts, Griffin (1990), Handbook of Human Vibration.
    """

    acc_m_s2: Annotated[float, Field(ge=0, description="RMS of each axis at 1 m/s, m/s²")] = 0.0
    gyro_rad_s: Annotated[float, Field(ge=0, description="RMS of each axis at 1 m/s, rad/s")] = 0.0
    spacing_m: Annotated[float, Field(gt=0, description="distance between grousers, m")] = 0.05


class WarmUp(StrictModel):
    """A bias that grows from zero to its final value as the IMU warms up; drawn once for each axis.

    Source: first-order thermal response; Titterton, Weston (2004), Strapdown Inertial Navigation Technology.
    """

    gyro_sigma_rad_s: Annotated[float, Field(ge=0, description="final bias, rad/s")] = 0.0
    acc_sigma_m_s2: Annotated[float, Field(ge=0, description="final bias, m/s²")] = 0.0
    time_constant_s: Annotated[float, Field(gt=0, description="s")] = 60.0


class Misalignment(StrictModel):
    """Rotation of the IMU relative to its stated mount, and scale errors; drawn once.

    Source: Tedaldi, Pretto, Menegatti (2014), doi:10.1109/ICRA.2014.6907297 (error model).
    """

    rotation_sigma_deg: Annotated[float, Field(ge=0, le=20, description="about each axis, °")] = 0.0
    scale_sigma: Annotated[float, Field(ge=0, le=0.1, description="of each axis, relative")] = 0.0


class ImuFaults(StrictModel):
    """Faults of the IMU."""

    vibration: Vibration | None = None
    warm_up: WarmUp | None = None
    misalignment: Misalignment | None = None


#: Number of harmonics of the vibration; their amplitudes are equal.
_HARMONICS = 3


def disturbed(
    faults: ImuFaults,
    acc_m_s2: FloatArray,
    gyro_rad_s: FloatArray,
    motion: tuple[FloatArray, FloatArray, FloatArray],
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Return readings of accelerometer and gyroscope ``(n, 3)`` with the faults.

    Parameters
    ----------
    motion : tuple of NDArray[np.float64], shape (n,)
        Times in seconds, speeds in m/s, and path lengths in metres.
    """
    t_s, speed, distance_m = motion
    if faults.misalignment is not None:
        R = se3.exp_so3(math.radians(faults.misalignment.rotation_sigma_deg) * rng.standard_normal(3))
        scale = 1.0 + faults.misalignment.scale_sigma * rng.standard_normal((2, 3))
        acc_m_s2, gyro_rad_s = acc_m_s2 @ R * scale[0], gyro_rad_s @ R * scale[1]
    if faults.warm_up is not None:
        bias = rng.standard_normal((2, 3))
        growth = 1.0 - np.exp(-t_s / faults.warm_up.time_constant_s)[:, None]
        acc_m_s2 = acc_m_s2 + faults.warm_up.acc_sigma_m_s2 * bias[0] * growth
        gyro_rad_s = gyro_rad_s + faults.warm_up.gyro_sigma_rad_s * bias[1] * growth
    if faults.vibration is not None:
        waves = [_waves(faults.vibration.spacing_m, speed, distance_m, rng) for _ in range(2)]
        acc_m_s2 = acc_m_s2 + faults.vibration.acc_m_s2 * waves[0]
        gyro_rad_s = gyro_rad_s + faults.vibration.gyro_rad_s * waves[1]
    return acc_m_s2, gyro_rad_s


def _waves(
    spacing_m: float, speed: FloatArray, distance_m: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return oscillations ``(n, 3)`` with an RMS of 1 at 1 m/s; their phase follows the path length."""
    order = np.arange(1, _HARMONICS + 1)
    phase = 2.0 * math.pi * (distance_m[:, None, None] / spacing_m * order + rng.random((3, _HARMONICS)))
    return np.asarray(speed[:, None] * math.sqrt(2.0 / _HARMONICS) * np.sin(phase).sum(axis=2))
