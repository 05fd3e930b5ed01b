# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mount of an inertial measurement unit from one drive with wheel odometry.

Three comparisons are solved together:

- Gravity: the mean specific force of a window points upwards in the base, because a drive is level on
  average.
- Rotation: the rotation about the vertical of the base equals the yaw of the wheels.
- Velocity: within a window the specific force, rotated by the gyro into the axes at the start of the window,
  is integrated to a velocity. Gravity, a tilt of the ground and the initial velocity are a line in time,
  which is removed from it and from the velocity of the wheels; what remains, accelerations and curves, must
  agree. This determines the yaw of the mount and, by curves, the lever arm.

The covariance is that of clusters (sandwich estimate over windows), since the errors within a window are
correlated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_core.calibration.estimate import WEAK_PRIOR, Mount

#: Duration of a window and period of the compared velocities, seconds.
WINDOW_S, _PERIOD_S = 4.0, 0.2
#: Least number of windows.
LEAST_WINDOWS = 8
#: Largest number of steps of the iteration.
_ITERATIONS = 60
#: Threshold of Huber's loss, standard deviations: 95 % efficient for normal errors.
_HUBER = 1.345
#: Prior of lever arm (0.5 m) and rotation.
_PRIOR = np.diag([4.0] * 3 + [1e-6] * 3)
#: Number of independent values among the velocities of a window, which are integrals of the same readings.
_INDEPENDENT = 4.0
#: Standard deviations of systematic errors that the residuals do not show, metres and radians: wheels slip
#: forwards and sideways with the slope, which acts like a lever arm, and a site is not level. On a simulated
#: rough drive the lever arm was 0.3 m off with a scatter of 0.05 m.
_SYSTEMATIC = np.array([0.15, 0.15, 0.0, *np.deg2rad([0.5, 0.5, 1.0])])
#: Smallest standard deviations: velocity (m/s), yaw (rad), and direction of gravity (rad).
_FLOORS = np.array([0.005, 0.001, 0.01])
#: Offsets between the clocks of unit and wheels that are tried, seconds.
_OFFSETS_S = np.arange(-0.5, 0.51, 0.02)
#: Number of initial rotations about the vertical, and least yaw rate of a useful drive, rad/s.
_STARTS, _LEAST_RATE = 12, 0.02


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """Data of a window at k times, with the line in time removed.

    Attributes
    ----------
    velocity : array, shape (k, 3)
        Integrated specific force in the axes of the unit at the start, m/s.
    wheels : array, shape (k, 3)
        Velocity of the base in its axes at the start, m/s.
    lever : array, shape (k, 3, 3)
        Velocity per metre of lever arm.
    rotation : array, shape (3,)
        Rotation vector of the unit, rad.
    yaw : float
        Yaw by the wheels, rad.
    up : array, shape (3,)
        Direction of the mean specific force.
    """

    velocity: FloatArray
    wheels: FloatArray
    lever: FloatArray
    rotation: FloatArray
    yaw: float
    up: FloatArray


def inertial_mount(
    imu_ns: NDArray[np.int64],
    force_m_s2: FloatArray,
    rate_rad_s: FloatArray,
    base_ns: NDArray[np.int64],
    base: FloatArray,
) -> tuple[Mount, float]:
    """Return the mount of an IMU and the offset of its clock.

    Parameters
    ----------
    imu_ns : array, shape (n,)
    force_m_s2, rate_rad_s : array, shape (n, 3)
        Specific force and angular rate in the axes of the unit.
    base_ns : array, shape (m,)
    base : array, shape (m, 4, 4)
        Poses of the base by the wheels, in a fixed frame.

    Returns
    -------
    mount : Mount
    offset_s : float
        Time to add to the stamps of the unit so that its rotation agrees with the wheels.

    Raises
    ------
    InputError
        If the two streams have no common interval of time.
    DegenerateGeometryError
        If there are fewer than ``LEAST_WINDOWS`` windows, or the robot did not move.
    """
    if len(imu_ns) < 2 or len(base_ns) < 2 or imu_ns[-1] <= base_ns[0] or imu_ns[0] >= base_ns[-1]:
        raise InputError("IMU and wheels have no common interval of time")
    origin_ns = int(base_ns[0])
    t_base = np.asarray((base_ns - origin_ns) * 1e-9, dtype=np.float64)
    t_imu = np.asarray((imu_ns - origin_ns) * 1e-9, dtype=np.float64)
    yaw = np.unwrap(np.arctan2(base[:, 1, 0], base[:, 0, 0]))
    offset_s = _clock_offset(t_imu, force_m_s2, rate_rad_s, t_base, yaw)
    windows = _windows(t_imu + offset_s, force_m_s2, rate_rad_s, t_base, base[:, :2, 3], yaw)
    if len(windows) < LEAST_WINDOWS:
        raise DegenerateGeometryError(
            f"{len(windows)} windows of {WINDOW_S:g} s with motion: expected at least "
            f"{LEAST_WINDOWS}; drive longer",
            ("motion",),
        )
    results = [_fit_from(windows, start) for start in _starts(windows)]
    mount, _ = min(results, key=lambda mount_and_cost: mount_and_cost[1])
    return mount, offset_s


def _clock_offset(
    t_imu: FloatArray, force: FloatArray, rate: FloatArray, t_base: FloatArray, yaw: FloatArray
) -> float:
    """Return the offset of the IMU times (added to them) at which the yaw rates correlate most.

    Without rotation it is 0.
    """
    up = force.mean(axis=0)
    yaw_rate = rate @ (up / np.linalg.norm(up))
    grid = np.arange(t_base[0] + 1.0, t_base[-1] - 1.0, 0.05)
    span_s = max(0.2, 2.0 * float(np.median(np.diff(t_base))))
    wheel_rate = (np.interp(grid + span_s, t_base, yaw) - np.interp(grid - span_s, t_base, yaw)) / (
        2 * span_s
    )
    if len(grid) < 50 or np.std(wheel_rate) < _LEAST_RATE:
        return 0.0
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (yaw_rate[1:] + yaw_rate[:-1]) * np.diff(t_imu))])
    scores = []
    for offset_s in _OFFSETS_S:
        t_shifted = grid - offset_s
        imu_rate = (
            np.interp(t_shifted + span_s, t_imu, angle) - np.interp(t_shifted - span_s, t_imu, angle)
        ) / (2 * span_s)
        scores.append(float(np.corrcoef(imu_rate, wheel_rate)[0, 1]))
    return float(_OFFSETS_S[int(np.argmax(scores))])


def _windows(
    t_imu: FloatArray,
    force: FloatArray,
    rate: FloatArray,
    t_base: FloatArray,
    position_m: FloatArray,
    yaw: FloatArray,
) -> list[_Window]:
    """Return the windows with motion."""
    span_s = max(_PERIOD_S, 2.0 * float(np.median(np.diff(t_base))))
    windows = []
    for start_s in np.arange(
        max(t_imu[0], t_base[0] + span_s), min(t_imu[-1], t_base[-1]) - WINDOW_S, WINDOW_S
    ):
        t_window = start_s + np.arange(0.0, WINDOW_S, _PERIOD_S)
        inside = np.flatnonzero((t_imu >= start_s) & (t_imu <= t_window[-1] + _PERIOD_S))
        if len(inside) < 2 * len(t_window) or np.diff(t_imu[inside]).max() > _PERIOD_S:
            continue
        velocity, rotation = _integrate_window(t_imu[inside], force[inside], rate[inside], t_window)
        x, y = (
            (np.interp(t_window + span_s / 2, t_base, c) - np.interp(t_window - span_s / 2, t_base, c))
            / span_s
            for c in position_m.T
        )
        angle = np.interp(t_window, t_base, yaw)
        turn_rate = (
            np.interp(t_window + span_s / 2, t_base, yaw) - np.interp(t_window - span_s / 2, t_base, yaw)
        ) / span_s
        if np.hypot(x, y).max() < 0.02 and np.abs(turn_rate).max() < _LEAST_RATE:
            continue
        c, s = np.cos(angle[0]), np.sin(angle[0])
        wheels = np.column_stack([c * x + s * y, c * y - s * x, np.zeros(len(t_window))])
        lever = np.zeros((len(t_window), 3, 3))
        for k, (heading, w) in enumerate(zip(angle - angle[0], turn_rate, strict=True)):
            lever[k] = se3.exp_so3([0, 0, heading]) @ se3.skew([0, 0, w])
        line = np.linalg.qr(np.column_stack([np.ones(len(t_window)), t_window - start_s]))[0]
        up = force[inside].mean(axis=0)
        windows.append(
            _Window(
                _without(line, velocity),
                _without(line, wheels),
                _without(line, lever.reshape(len(t_window), 9)).reshape(-1, 3, 3),
                rotation,
                float(angle[-1] - angle[0]),
                up / np.linalg.norm(up),
            )
        )
    return windows


def _without(line: FloatArray, values: FloatArray) -> FloatArray:
    """Return columns without their projection on the line."""
    return np.asarray(values - line @ (line.T @ values))


def _integrate_window(
    t: FloatArray, force: FloatArray, rate: FloatArray, at: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return velocities ``(k, 3)`` and the rotation vector ``(3,)`` in the axes at the start of a window."""
    steps = np.diff(t)
    R = np.eye(3)
    forces = np.empty_like(force)
    rotation_at = np.empty((len(t), 3))
    for k in range(len(t)):
        forces[k], rotation_at[k] = R @ force[k], se3.log_so3(R)
        if k < len(steps):
            R = R @ se3.exp_so3(0.5 * (rate[k] + rate[k + 1]) * steps[k])
    increments = 0.5 * (forces[1:] + forces[:-1]) * steps[:, None]
    velocity = np.concatenate([np.zeros((1, 3)), np.cumsum(increments, axis=0)])
    columns = [np.interp(at, t, v) for v in velocity.T]
    return np.column_stack(columns), np.array([np.interp(at[-1], t, r) for r in rotation_at.T])


def _starts(windows: list[_Window]) -> list[FloatArray]:
    """Return rotations that align gravity, one for each start of the yaw."""
    up = np.mean([w.up for w in windows], axis=0)
    up /= np.linalg.norm(up)
    helper = np.eye(3)[int(np.argmin(np.abs(up)))]
    x = np.cross(helper, up)
    x /= np.linalg.norm(x)
    level = np.array([x, np.cross(up, x), up])
    return [se3.exp_so3([0, 0, yaw]) @ level for yaw in np.arange(_STARTS) * 2 * np.pi / _STARTS]


def _fit_from(windows: list[_Window], R: FloatArray) -> tuple[Mount, float]:
    """Return the mount from a start rotation and the cost of its residuals."""
    lever = np.zeros(3)
    for _ in range(_ITERATIONS):
        H, clusters, sigma, rms = _normal_equations(windows, R, lever)
        gradient = clusters.sum(axis=0) + _PRIOR @ np.array([*lever, 0.0, 0.0, 0.0])
        step = -np.linalg.solve(H + _PRIOR, gradient)
        step *= min(1.0, 0.3 / max(float(np.linalg.norm(step[3:])), 1e-12))
        lever, R = lever + step[:3], se3.exp_so3(step[3:]) @ R
        if float(np.abs(step).max()) < 1e-8:
            break
    inverse = np.linalg.inv(H + WEAK_PRIOR)
    spread = clusters.T @ clusters * len(windows) / (len(windows) - 1)
    covariance = inverse @ (spread + WEAK_PRIOR) @ inverse + np.diag(np.square(_SYSTEMATIC))
    T = se3.transform(se3.normalise_rotation(R), lever)
    mount = Mount.of_covariance(T, covariance, len(windows), rms_m=rms, rms_rad=float(sigma[1]))
    fit = float(np.log(sigma) @ [_INDEPENDENT, 1.0, 2.0]) * len(windows)
    return mount, fit + 0.5 * float(lever @ _PRIOR[:3, :3] @ lever)


def _normal_equations(
    windows: list[_Window], R: FloatArray, lever: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return Hessian ``(6, 6)``, gradients of the windows ``(w, 6)``, sigmas ``(3,)``, and rms, m/s."""
    velocity, yaw, tilt = [], [], []
    for w in windows:
        own = w.velocity @ R.T
        velocity.append((own - w.wheels - w.lever @ lever)[:, :2])
        yaw.append(float((R @ w.rotation)[2] - w.yaw))
        tilt.append((R @ w.up)[:2])
    flat = np.concatenate(velocity)
    sigma = np.maximum(
        1.4826 * np.array([np.median(np.abs(v)) for v in (flat, np.array(yaw), np.concatenate(tilt))]),
        _FLOORS,
    )
    H, clusters = np.zeros((6, 6)), np.zeros((len(windows), 6))
    for k, w in enumerate(windows):
        J = np.zeros((len(w.velocity), 3, 6))
        J[:, :, :3], J[:, :, 3:] = -w.lever, -se3.skew(w.velocity @ R.T)
        rows = [(velocity[k].reshape(-1), J[:, :2].reshape(-1, 6), np.array(sigma[0]))]
        turn, gravity = np.zeros((1, 6)), np.zeros((2, 6))
        turn[0, 3:], gravity[:, 3:] = -se3.skew(R @ w.rotation)[2], -se3.skew(R @ w.up)[:2]
        rows += [(np.array([yaw[k]]), turn, np.array(sigma[1])), (tilt[k], gravity, np.array(sigma[2]))]
        for r, jacobian, s in rows:
            weight = np.minimum(1.0, _HUBER * s / np.maximum(np.abs(r), 1e-12)) / s**2
            weight *= min(1.0, _INDEPENDENT / len(r))
            H += jacobian.T @ (weight[:, None] * jacobian)
            clusters[k] += jacobian.T @ (weight * r)
    return H, clusters, sigma, float(np.sqrt((flat**2).sum(axis=1).mean()))
