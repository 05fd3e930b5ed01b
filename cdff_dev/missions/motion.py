# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How a rover that is told a way drives it: it turns on the spot, then follows the way with smooth speed."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation, RotationSpline

from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.drive import Motion, settle
from cdff_dev.simulate.relief import Relief
from cdff_dev.simulate.scenario import Chassis

_KNOT_HZ = 20.0
_TURN_RAD_S = math.radians(20.0)
#: It slows down where the way bends so that it turns no faster, rad/s.
_BEND_RAD_S = 0.8
_PAUSE_S = 0.25
#: The sharpest corner that is driven without a stop.
SHARPEST_RAD = math.radians(120.0)
#: Corners are rounded by a Gaussian of this, metres: a right angle is cut by 0.56 of it.
_ROUND_M = 0.15
#: It is slow from so far before a bend on, metres, and by no more than this factor.
_BRAKE_M, _SLOWEST = 0.4, 10.0
_STEP_M = 0.02


def standing(T_site_base: FloatArray, duration_s: float) -> Motion:
    """A rover that stands, for so many seconds."""
    t_s = np.array([0.0, duration_s])
    attitude = Rotation.from_matrix(np.array([T_site_base[:3, :3]] * 2))
    return Motion(CubicSpline(t_s, [T_site_base[:3, 3]] * 2), RotationSpline(t_s, attitude), CubicSpline(t_s, [0, 0]))


def along(
    way_m: FloatArray, heading_rad: float, speed_m_s: float, ramp_s: float, chassis: Chassis, felt: Relief
) -> tuple[Motion, float]:
    """The motion along a way, and how long it takes, seconds; it begins and ends at rest.

    Parameters
    ----------
    way_m : ndarray, shape (n, 2)
        Corners in site, the first where the rover stands, n at least 2.
    heading_rad : float
        Of the rover at the begin.
    felt : Relief
        Ground as wheels feel it.
    """
    xy, ahead = _rounded(way_m)
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
    # A metre of a bend counts as more metres, so that it is driven slower.
    slow = np.clip(speed_m_s / _BEND_RAD_S * np.abs(np.gradient(ahead, s)), 1.0, _SLOWEST)
    slow = maximum_filter1d(slow, round(_BRAKE_M / _STEP_M) | 1, mode="nearest")
    slow = gaussian_filter1d(slow, _BRAKE_M / _STEP_M / 2.0, mode="nearest")
    length_m = np.concatenate([[0.0], np.cumsum(0.5 * (slow[1:] + slow[:-1]) * np.diff(s))])
    turn_rad = math.remainder(ahead[0] - heading_rad, 2.0 * math.pi)
    turn_s = 1.875 * abs(turn_rad) / _TURN_RAD_S  # 1.875: the steepest part of the ramp
    drive_s = max(length_m[-1] / speed_m_s, ramp_s) + ramp_s
    begin_s = _PAUSE_S + turn_s + _PAUSE_S
    end_s = begin_s + drive_s + _PAUSE_S
    t_s = np.arange(0.0, end_s + 1.0, 1.0 / _KNOT_HZ)
    pace = _ramp((t_s - begin_s) / ramp_s) - _ramp((t_s - begin_s - drive_s + ramp_s) / ramp_s)
    driven = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]))])
    distance = np.interp(length_m[-1] * driven / driven[-1], length_m, s)
    at = np.stack([np.interp(distance, s, xy[:, 0]), np.interp(distance, s, xy[:, 1])], axis=1)
    turned = heading_rad + turn_rad * _ramp((t_s - _PAUSE_S) / max(turn_s, 1e-9))
    heading = turned + np.interp(distance, s, ahead) - ahead[0]
    poses = settle(felt, chassis, at, heading)
    attitude = RotationSpline(t_s, Rotation.from_matrix(poses[:, :3, :3]))
    return Motion(CubicSpline(t_s, poses[:, :3, 3]), attitude, CubicSpline(t_s, distance)), end_s


def sharpest_turn_rad(way_m: FloatArray) -> float:
    """The largest turn at a corner of a way, shape (n, 2)."""
    steps = np.diff(way_m, axis=0)
    steps = steps[np.linalg.norm(steps, axis=1) > 1e-6]
    ahead = np.arctan2(steps[:, 1], steps[:, 0])
    turns = np.abs(np.angle(np.exp(1j * np.diff(ahead))))
    return float(turns.max(initial=0.0))


def _rounded(way_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places about every ``_STEP_M`` along the way with rounded corners, and the headings there."""
    apart = np.concatenate([[True], np.linalg.norm(np.diff(way_m, axis=0), axis=1) > 1e-6])
    corners = way_m[apart]
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    even = np.linspace(0.0, s[-1], max(2, round(s[-1] / _STEP_M) + 1))
    straight = np.stack([np.interp(even, s, corners[:, axis]) for axis in range(2)], axis=1)
    wide = math.ceil(4.0 * _ROUND_M / _STEP_M)
    beyond = np.pad(straight, ((wide, wide), (0, 0)), mode="reflect", reflect_type="odd")  # both ends stay
    xy = gaussian_filter1d(beyond, _ROUND_M / _STEP_M, axis=0, truncate=4.0)[wide:-wide]
    step = np.gradient(xy, axis=0)
    return xy, np.unwrap(np.arctan2(step[:, 1], step[:, 0]))


def _ramp(u: FloatArray) -> FloatArray:
    c = np.clip(u, 0.0, 1.0)
    return np.asarray(c**3 * (10.0 - 15.0 * c + 6.0 * c**2))
