# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""True motion of a rover: a path over the terrain, with the attitude that its wheels give it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.spatial.transform import Rotation, RotationSpline

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.relief import Relief
from cdff_dev.simulate.scenario import Chassis, RoverPath

#: Rate of the spline knots.
_KNOT_HZ = 20.0


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """The true motion of ``{robot}/base`` in ``site``, twice differentiable, over seconds since the epoch.

    Attributes
    ----------
    position : CubicSpline
        Position (3,), metres.
    attitude : RotationSpline
    distance : CubicSpline
        Path length, metres.
    """

    position: CubicSpline
    attitude: RotationSpline
    distance: CubicSpline

    def poses(self, t_s: FloatArray) -> FloatArray:
        """Return ``T_site_base`` ``(n, 4, 4)`` at times ``(n,)``."""
        return se3.transform(self.attitude(t_s).as_matrix(), self.position(t_s))

    def body_rates(self, t_s: FloatArray) -> FloatArray:
        """Return angular rates ``(n, 3)`` of the base in base axes, rad/s."""
        return np.asarray(self.attitude(t_s, 1), dtype=np.float64)

    def body_accelerations(self, t_s: FloatArray) -> FloatArray:
        """Return angular accelerations ``(n, 3)`` of the base in base axes, rad/s^2."""
        return np.asarray(self.attitude(t_s, 2), dtype=np.float64)

    def acceleration(self, t_s: FloatArray) -> FloatArray:
        """Return accelerations ``(n, 3)`` of the origin of the base in site axes, m/s^2."""
        return np.asarray(self.position(t_s, 2), dtype=np.float64)


def _distance_travelled(drive: RoverPath, duration_s: float, t_s: FloatArray) -> FloatArray:
    """Return the path length at times ``t_s``; speed rises and falls smoothly between two rests."""
    stop_s = duration_s - drive.rest_after_s

    def ramp(u: FloatArray) -> FloatArray:
        c = np.clip(u, 0.0, 1.0)
        return np.asarray(c**3 * (10.0 - 15.0 * c + 6.0 * c**2))

    fine = np.arange(0.0, duration_s + 2e-3, 1e-3)
    speed = drive.speed_m_s * (
        ramp((fine - drive.rest_before_s) / drive.ramp_s)
        - ramp((fine - stop_s + drive.ramp_s) / drive.ramp_s)
    )
    distance_m = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 1e-3)])
    return np.asarray(np.interp(t_s, fine, distance_m))


def track(drive: RoverPath, distance_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points ``(n, 2)`` and headings ``(n,)`` in site, metres and radians, at distances on a path."""
    knots = np.array(drive.curvature_1pm)
    lengths_m = np.arange(0.0, max(float(np.max(distance_m)), 0.01) + 0.01, 0.005)
    curvature = PchipInterpolator(knots[:, 0], knots[:, 1], extrapolate=True)(
        np.clip(lengths_m, knots[0, 0], knots[-1, 0])
    )

    def integral(values: FloatArray) -> FloatArray:
        return np.asarray(np.concatenate([[0], np.cumsum(0.5 * (values[1:] + values[:-1]))]) * 0.005)

    heading = math.radians(drive.heading_deg) + integral(curvature)
    x = drive.start_xy_m[0] + integral(np.cos(heading))
    y = drive.start_xy_m[1] + integral(np.sin(heading))
    xy = np.stack([np.interp(distance_m, lengths_m, x), np.interp(distance_m, lengths_m, y)], axis=1)
    return xy, np.interp(distance_m, lengths_m, heading)


def settle(relief: Relief, chassis: Chassis, xy_m: FloatArray, heading_rad: FloatArray) -> FloatArray:
    """Return ``T_site_base`` ``(n, 4, 4)`` of a rover with its wheels on the ground at points ``(n, 2)``.

    The attitude is that of the least-squares plane through the four contact points, which corresponds to a
    rocker suspension. The base is ``base_height_m`` above the plane.
    """
    half = 0.5 * np.array([[chassis.wheelbase_m, chassis.track_m]])
    wheels = half * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    ahead = np.stack([c, s], 1)
    left = np.stack([-s, c], 1)
    contacts = (
        xy_m[:, None, :] + wheels[None, :, :1] * ahead[:, None, :] + wheels[None, :, 1:] * left[:, None, :]
    )
    z = relief.height(contacts.reshape(-1, 2)).reshape(-1, 4)
    pitch_slope = z @ np.array([1, 1, -1, -1]) / (2.0 * chassis.wheelbase_m)
    roll_slope = z @ np.array([1, -1, 1, -1]) / (2.0 * chassis.track_m)
    x_axis = np.concatenate([ahead, pitch_slope[:, None]], 1)
    y_axis = np.concatenate([left, roll_slope[:, None]], 1)
    normal = np.cross(x_axis, y_axis)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    x_axis /= np.linalg.norm(x_axis, axis=1, keepdims=True)
    R = np.stack([x_axis, np.cross(normal, x_axis), normal], axis=2)
    ground = np.concatenate([xy_m, z.mean(axis=1)[:, None]], 1)
    return se3.transform(R, ground + chassis.base_height_m * normal)


def make_motion(drive: RoverPath, chassis: Chassis, relief: Relief, duration_s: float) -> Motion:
    """Return the true motion of one rover.

    Poses at 20 Hz are interpolated by splines, so that rates and accelerations exist and IMU readings are
    consistent with the poses.
    """
    sigma_cells = chassis.wheel_footprint_m / float(np.min(np.diff(relief.x_m)))
    wheel_relief = relief.smoothed(sigma_cells)
    t_s = np.arange(0.0, duration_s + 1.0, 1.0 / _KNOT_HZ)
    distance = _distance_travelled(drive, duration_s, t_s)
    xy, heading = track(drive, distance)
    poses = settle(wheel_relief, chassis, xy, heading)
    return Motion(
        CubicSpline(t_s, poses[:, :3, 3]),
        RotationSpline(t_s, Rotation.from_matrix(poses[:, :3, :3])),
        CubicSpline(t_s, distance),
    )
