# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scales of wheel odometry from one drive: radius of the wheels and track width of a differential drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_core.calibration.motions import MotionPairs

#: Distance, metres, and sum of absolute yaws, radians, that a drive needs for radius and track width.
LEAST_M, LEAST_RAD = 5.0, np.deg2rad(180.0)
#: Threshold of Huber's loss, standard deviations (95 % efficient for normal errors), and number of steps.
_HUBER, _ITERATIONS = 1.345, 20


@dataclass(frozen=True, slots=True)
class WheelScales:
    """Factors on the parameters with which the odometry was computed.

    Attributes
    ----------
    radius, radius_sigma : float
        True radius of the wheels over the used one.
    track, track_sigma : float
        True (effective) track width over the used one; on skidding wheels it is larger than the geometric
        one.
    distance_m, yaw_rad : float
        Distance and sum of absolute yaws that were compared.
    """

    radius: float
    radius_sigma: float
    track: float
    track_sigma: float
    distance_m: float
    yaw_rad: float


def wheel_scales(pairs: MotionPairs, mount: FloatArray) -> WheelScales:
    """Return the scales of wheel odometry from the motions of a sensor that measures in metres.

    Parameters
    ----------
    pairs : MotionPairs
        Motions by wheels (``base``) and by lidar or stereo odometry (``sensor``).
    mount : array, shape (4, 4)
        Mount ``T_base_sensor`` of this sensor.

    Raises
    ------
    DegenerateGeometryError
        If the drive is shorter than ``LEAST_M`` or has less yaw than ``LEAST_RAD``.

    Notes
    -----
    Odometry of a differential drive has distance ``r (a_r + a_l) / 2`` and yaw ``r (a_r - a_l) / w`` of the
    wheel angles. With the ratios ``s`` of distances and ``k`` of yaws, true over odometry, the radius is
    ``s`` times and the track width ``s / k`` times the used one.
    """
    sensor_motions = mount @ pairs.sensor @ se3.inverse(mount)
    true_rad, odometry_rad = (se3.log_so3(m[:, :3, :3])[:, 2] for m in (sensor_motions, pairs.base))
    true_m, odometry_m = _arc_m(sensor_motions, true_rad), _arc_m(pairs.base, odometry_rad)
    distance_m, yaw_rad = float(np.abs(true_m).sum()), float(np.abs(true_rad).sum())
    missing = tuple(
        n for n, short in (("radius", distance_m < LEAST_M), ("track", yaw_rad < LEAST_RAD)) if short
    )
    if missing:
        raise DegenerateGeometryError(
            f"the drive has {distance_m:.1f} m and {np.rad2deg(yaw_rad):.0f}° of curves: expected at least "
            f"{LEAST_M:g} m and {np.rad2deg(LEAST_RAD):.0f}°",
            missing,
        )
    radius, radius_sigma = _ratio(odometry_m, true_m)
    yaw, yaw_sigma = _ratio(odometry_rad, true_rad)
    track = radius / yaw
    relative = np.hypot(radius_sigma / radius, yaw_sigma / yaw)
    return WheelScales(radius, radius_sigma, track, float(track * relative), distance_m, yaw_rad)


def _arc_m(motions: FloatArray, yaw_rad: FloatArray) -> FloatArray:
    """Return the lengths of arcs ``(n,)`` with the yaws, from their chords along the mean heading."""
    half = 0.5 * yaw_rad
    chord = motions[:, 0, 3] * np.cos(half) + motions[:, 1, 3] * np.sin(half)
    return np.asarray(chord / np.sinc(half / np.pi))


def _ratio(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return the robust ratio ``y / x`` and its standard deviation."""
    ratio, weights = float(x @ y / (x @ x)), np.ones(len(x))
    for _ in range(_ITERATIONS):
        residuals = y - ratio * x
        sigma = max(1.4826 * float(np.median(np.abs(residuals))), 1e-6)
        weights = np.minimum(1.0, _HUBER * sigma / np.maximum(np.abs(residuals), 1e-12))
        ratio = float((weights * x) @ y / ((weights * x) @ x))
    residuals = y - ratio * x
    variance = ((weights * x * residuals) ** 2).sum() / ((weights * x) @ x) ** 2
    return ratio, float(np.sqrt(variance))
