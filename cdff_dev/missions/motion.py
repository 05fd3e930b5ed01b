# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of a rover along a path: it turns in place, then follows the path with continuous speed."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation, RotationSpline

from cdff_common.geometry.se3 import FloatArray
from cdff_dev.missions.tracks import path_lengths_m
from cdff_dev.simulate.relief import Relief
from cdff_dev.simulate.rover_motion import Motion, settle
from cdff_dev.simulate.scenario import Chassis

#: Rate of the spline knots, and largest rate of a turn in place.
_KNOT_HZ = 20.0
_TURN_RAD_S = math.radians(20.0)
#: Largest yaw rate while driving, rad/s: the rover slows down in bends.
_BEND_RAD_S = 0.8
#: Rest before and after the turn in place and after the drive, seconds.
_PAUSE_S = 0.25
#: Largest change of direction at a corner that is driven without a stop.
MAX_CORNER_RAD = math.radians(120.0)
#: Standard deviation of the Gaussian that rounds corners, metres; the path passes a right-angled
#: corner at 0.56 of it.
_ROUNDING_M = 0.15
#: Distance before a bend at which braking starts, metres, and largest factor by which the speed is reduced.
_BRAKE_M, _MAX_SLOWDOWN = 0.4, 10.0
#: Spacing of the points of a rounded path, metres.
_STEP_M = 0.02


def motion_at_rest(T_site_base: FloatArray, duration_s: float) -> Motion:
    """Return the motion of a rover at rest."""
    t_s = np.array([0.0, duration_s])
    attitude = Rotation.from_matrix(np.array([T_site_base[:3, :3]] * 2))
    return Motion(
        CubicSpline(t_s, [T_site_base[:3, 3]] * 2), RotationSpline(t_s, attitude), CubicSpline(t_s, [0, 0])
    )


def motion_along_path(
    path_m: FloatArray,
    heading_rad: float,
    speed_m_s: float,
    ramp_s: float,
    chassis: Chassis,
    wheel_relief: Relief,
) -> tuple[Motion, float]:
    """Return the motion along a path and its duration, seconds; it starts and ends at rest.

    Parameters
    ----------
    path_m : ndarray, shape (n, 2)
        Corners in site, at least two; the first is the position of the rover.
    heading_rad : float
        Heading of the rover at the start.
    wheel_relief : Relief
        Terrain smoothed over the footprint of a wheel.
    """
    xy, path_heading_rad = _round_corners(path_m)
    lengths_m = path_lengths_m(xy)
    # Each metre is weighted by the factor by which the speed on it is reduced.
    slowdown = np.clip(
        speed_m_s / _BEND_RAD_S * np.abs(np.gradient(path_heading_rad, lengths_m)), 1.0, _MAX_SLOWDOWN
    )
    slowdown = maximum_filter1d(slowdown, round(_BRAKE_M / _STEP_M) | 1, mode="nearest")
    slowdown = gaussian_filter1d(slowdown, _BRAKE_M / _STEP_M / 2.0, mode="nearest")
    weighted_length_m = np.concatenate(
        [[0.0], np.cumsum(0.5 * (slowdown[1:] + slowdown[:-1]) * np.diff(lengths_m))]
    )
    turn_rad = math.remainder(path_heading_rad[0] - heading_rad, 2.0 * math.pi)
    turn_s = 1.875 * abs(turn_rad) / _TURN_RAD_S  # 1.875: largest slope of _ramp
    drive_s = max(weighted_length_m[-1] / speed_m_s, ramp_s) + ramp_s
    start_s = _PAUSE_S + turn_s + _PAUSE_S
    end_s = start_s + drive_s + _PAUSE_S
    t_s = np.arange(0.0, end_s + 1.0, 1.0 / _KNOT_HZ)
    relative_speed = _ramp((t_s - start_s) / ramp_s) - _ramp((t_s - start_s - drive_s + ramp_s) / ramp_s)
    cumulative_speed = np.concatenate([[0.0], np.cumsum(0.5 * (relative_speed[1:] + relative_speed[:-1]))])
    weighted_m = weighted_length_m[-1] * cumulative_speed / cumulative_speed[-1]
    distance_m = np.interp(weighted_m, weighted_length_m, lengths_m)
    position_xy = np.stack(
        [np.interp(distance_m, lengths_m, xy[:, 0]), np.interp(distance_m, lengths_m, xy[:, 1])], axis=1
    )
    turn_in_place = heading_rad + turn_rad * _ramp((t_s - _PAUSE_S) / max(turn_s, 1e-9))
    heading = turn_in_place + np.interp(distance_m, lengths_m, path_heading_rad) - path_heading_rad[0]
    poses = settle(wheel_relief, chassis, position_xy, heading)
    attitude = RotationSpline(t_s, Rotation.from_matrix(poses[:, :3, :3]))
    return Motion(CubicSpline(t_s, poses[:, :3, 3]), attitude, CubicSpline(t_s, distance_m)), end_s


def sharpest_turn_rad(path_m: FloatArray) -> float:
    """Return the largest change of direction at a corner of a path, shape (n, 2)."""
    steps = np.diff(path_m, axis=0)
    steps = steps[np.linalg.norm(steps, axis=1) > 1e-6]
    path_heading_rad = np.arctan2(steps[:, 1], steps[:, 0])
    turns = np.abs(np.angle(np.exp(1j * np.diff(path_heading_rad))))
    return float(turns.max(initial=0.0))


def _round_corners(path_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions about every ``_STEP_M`` along the path with rounded corners, and their headings."""
    is_distinct = np.concatenate([[True], np.linalg.norm(np.diff(path_m, axis=0), axis=1) > 1e-6])
    corners = path_m[is_distinct]
    lengths_m = path_lengths_m(corners)
    even_s = np.linspace(0.0, lengths_m[-1], max(2, round(lengths_m[-1] / _STEP_M) + 1))
    straight = np.stack([np.interp(even_s, lengths_m, corners[:, axis]) for axis in range(2)], axis=1)
    padding = math.ceil(4.0 * _ROUNDING_M / _STEP_M)
    # An odd reflection keeps both ends of the path in place.
    extended = np.pad(straight, ((padding, padding), (0, 0)), mode="reflect", reflect_type="odd")
    xy = gaussian_filter1d(extended, _ROUNDING_M / _STEP_M, axis=0, truncate=4.0)[padding:-padding]
    step = np.gradient(xy, axis=0)
    return xy, np.unwrap(np.arctan2(step[:, 1], step[:, 0]))


def _ramp(u: FloatArray) -> FloatArray:
    """Return the smooth step from 0 at ``u <= 0`` to 1 at ``u >= 1``, twice differentiable."""
    c = np.clip(u, 0.0, 1.0)
    return np.asarray(c**3 * (10.0 - 15.0 * c + 6.0 * c**2))
