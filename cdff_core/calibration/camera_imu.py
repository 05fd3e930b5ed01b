# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose of an inertial measurement unit in the frame of a camera, from images of a fixed board.

Poses and velocities of the camera at the times of the images are estimated together with the pose of the
unit, the offset of its clock, the biases of gyro and accelerometer, and gravity. Two successive images are
connected by the integrals of the readings between them [1]_, which start and end at the times of the images
in the clock of the IMU: their derivative by these times determines the offset [2]_. The start is the
rotation between the angular rates of camera and unit at the offset at which they correlate most, so that no
guess is needed. The noise of the IMU is estimated from its readings.

References
----------
.. [1] Forster, C. et al. (2017). On-manifold preintegration for real-time visual-inertial odometry. IEEE
  Transactions on Robotics 33(1). doi:10.1109/TRO.2016.2597321
.. [2] Furgale, P., Rehder, J., Siegwart, R. (2013). Unified temporal and spatial calibration for multi-sensor
  systems. IROS. doi:10.1109/IROS.2013.6696514
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import inverse_covariance
from cdff_core.calibration.board_poses import BoardPose
from cdff_core.calibration.camera_imu_start import (
    LARGEST_OFFSET_S,
    agreed_rotation,
    connected,
    require_intervals,
)
from cdff_core.calibration.imu_integrals import (
    Integrals,
    Readings,
    derivatives,
    integrals,
    noise_densities,
)
from cdff_core.calibration.relative_pose import RelativePose, undetermined_directions

#: Names of the common parameters: pose of the IMU in the camera, biases, gravity in the frame of the board,
#: and time to add to the stamps of the IMU; metres, radians, rad/s, m/s² and seconds.
PARAMETERS = (
    *("x", "y", "z", "roll", "pitch", "yaw"),
    *("gyro_bias_x_rad_s", "gyro_bias_y_rad_s", "gyro_bias_z_rad_s"),
    *("accelerometer_bias_x_m_s2", "accelerometer_bias_y_m_s2", "accelerometer_bias_z_m_s2"),
    *("gravity_x_m_s2", "gravity_y_m_s2", "gravity_z_m_s2"),
    "time_offset_s",
)
#: Poses of the board above this Mahalanobis distance (99.9 % of six degrees of freedom) are dropped.
_GATE = 4.74
#: Thresholds of Huber's loss, Mahalanobis distance (95 % of 6 and 9 degrees of freedom).
_HUBER_POSE, _HUBER_INTERVAL = 3.55, 4.11
_ITERATIONS = 40
#: Largest step of a parameter, in its standard deviations, that ends the adjustment, and that is accepted
#: after the last iteration.
_CONVERGED_SIGMA, _LARGEST_STEP_SIGMA = 1e-3, 0.5
#: Weak priors, standard deviations in the order of ``PARAMETERS``. Gravity has one of its length instead.
_PRIOR = np.diag([0.01] * 3 + [1.0 / np.pi**2] * 3 + [1.0] * 3 + [1.0 / 0.5**2] * 3 + [0.0] * 3 + [1.0])
_GRAVITY_SIGMA = 0.02
#: Least noise of a unit without measurable noise: rad/s/√Hz and m/s²/√Hz.
_NOISE_FLOORS = np.array([1e-5, 1e-4])
#: Standard deviation of a determined offset of the clocks, seconds.
_OFFSET_LIMIT_S = 1e-3
#: Standard deviation of the position along the axis of a rotation about one axis only, metres: noise of the
#: poses must not count as information.
_ALONG_AXIS_M = 10.0
#: Part of the images above which dropped ones are mentioned in the assessment.
_DROPPED_PART = 0.03
#: Ratio of the rates about the second and the first axis below which the camera rotates about one axis only.
_LEAST_SPREAD = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class CameraImu:
    """Calibration of a camera and an inertial measurement unit.

    Attributes
    ----------
    pose : RelativePose
        Pose of the IMU in the frame of the camera.
    values : ndarray, shape (16,)
        Values of ``PARAMETERS`` after the six of the pose; those six are 0.
    covariance : ndarray, shape (16, 16)
        Of ``PARAMETERS``; errors of the pose in the axes of the camera.
    """

    pose: RelativePose
    values: FloatArray
    covariance: FloatArray


@dataclass(slots=True, eq=False)
class _State:
    """Poses ``T_board_camera`` (n, 4, 4), velocities of the IMU ``(n, 3)`` and the common parameters."""

    T: FloatArray
    velocity: FloatArray
    T_camera_imu: FloatArray
    values: FloatArray

    @property
    def offset_s(self) -> float:
        return float(self.values[15])

    def move(self, states: FloatArray, common: FloatArray) -> None:
        """Add a step ``(n, 9)`` of position, rotation and velocity, and ``(16,)`` of the parameters."""
        self.T = se3.transform(
            se3.exp_so3(states[:, 3:6]) @ self.T[:, :3, :3], self.T[:, :3, 3] + states[:, :3]
        )
        self.velocity = self.velocity + states[:, 6:]
        X = self.T_camera_imu
        self.T_camera_imu = se3.transform(se3.exp_so3(common[3:6]) @ X[:3, :3], X[:3, 3] + common[:3])
        self.values = self.values + np.concatenate([np.zeros(6), common[6:]])


@dataclass(frozen=True, slots=True, eq=False)
class _Data:
    """Times ``(n,)`` of the images, measured poses, their covariances, connected pairs and the readings."""

    t_s: FloatArray
    T: FloatArray
    covariance: FloatArray
    pairs: NDArray[np.int64]
    readings: Readings
    noise: FloatArray
    gravity_m_s2: float

    @property
    def duration_s(self) -> FloatArray:
        return np.asarray(self.t_s[self.pairs + 1] - self.t_s[self.pairs])


def camera_imu_calibration(
    stamps_ns: NDArray[np.int64],
    boards: Sequence[BoardPose],
    imu_ns: NDArray[np.int64],
    force_m_s2: FloatArray,
    rate_rad_s: FloatArray,
    *,
    gravity_m_s2: float = 9.80665,
    largest_offset_s: float = LARGEST_OFFSET_S,
) -> CameraImu:
    """Return the pose of a unit in the frame of a camera, the offset of its clock, and its biases.

    Parameters
    ----------
    stamps_ns : ndarray, shape (m,)
        Times of all images.
    boards : sequence of BoardPose
        Poses of the board; ``number`` is the index of the image.
    imu_ns : ndarray, shape (n,)
        Ascending times of the readings.
    force_m_s2, rate_rad_s : ndarray, shape (n, 3)
        Specific force (upwards at rest) and angular rate in the axes of the IMU.
    gravity_m_s2 : float
        Acceleration of gravity at the place of the calibration.
    largest_offset_s : float
        Largest absolute offset of the clocks.

    Raises
    ------
    InputError
        If images and readings have no common interval of time.
    DegenerateGeometryError
        If fewer than ``LEAST_INTERVALS`` pairs of images show the board, the camera does not rotate, its
        rotation is not that of the IMU, or the adjustment does not converge.
    """
    origin_ns = int(stamps_ns[0]) if len(stamps_ns) else 0
    own = np.array([stamps_ns[board.number] for board in boards], np.int64)
    order = np.argsort(own, kind="stable")
    t_s = np.asarray((own[order] - origin_ns) * 1e-9, np.float64)
    readings = Readings(
        np.asarray((imu_ns - origin_ns) * 1e-9, np.float64),
        np.asarray(force_m_s2, np.float64),
        np.asarray(rate_rad_s, np.float64),
    )
    if (
        len(imu_ns) < 10
        or not np.isfinite(readings.force_m_s2).all() & np.isfinite(readings.rate_rad_s).all()
    ):
        raise InputError(f"{len(imu_ns)} readings of the IMU: expected at least 10, with finite values")
    if len(t_s) > 1 and (readings.t_s[-1] <= t_s[0] or readings.t_s[0] >= t_s[-1]):
        raise InputError(
            "images and readings of the IMU have no common interval of time: relative to the first image, "
            f"the readings start at {readings.t_s[0] - t_s[0]:.3f} s and end at "
            f"{readings.t_s[-1] - t_s[0]:.3f} s; check that both have stamps of one clock"
        )
    T_camera_board = np.array([boards[k].T_camera_board for k in order]).reshape(-1, 4, 4)
    covariance = np.array([boards[k].covariance for k in order]).reshape(-1, 6, 6)
    start_offset_s, R, is_kept = agreed_rotation(t_s, T_camera_board, readings, largest_offset_s)
    kept = np.flatnonzero(is_kept)
    T = se3.inverse(T_camera_board[kept])
    data = _Data(
        t_s[kept],
        T,
        inverse_covariance(T_camera_board[kept], covariance[kept]),
        connected(t_s[kept], readings, start_offset_s, margin_s=0.02),
        readings,
        np.maximum(noise_densities(readings), _NOISE_FLOORS),
        gravity_m_s2,
    )
    require_intervals(len(data.pairs), len(boards))
    state = _start_state(data, R, start_offset_s)
    common, is_used, fit = _adjusted(data, state)
    axis, spread = _rotation_axis(readings)
    if spread < _LEAST_SPREAD:
        along = state.T_camera_imu[:3, :3] @ axis
        common[:3, :3] += _ALONG_AXIS_M**2 * np.outer(along, along)
    state.T_camera_imu = se3.normalise_transform(state.T_camera_imu)
    dropped = len(boards) - int(is_used.sum())
    return CameraImu(_result(data, state, common, is_used, fit, dropped), state.values, common)


def _start_state(data: _Data, R: FloatArray, offset_s: float) -> _State:
    """Return the start: the poses of the board, their differences, and the mean specific force as gravity."""
    position = data.T[:, :3, 3]
    velocity = np.stack([np.gradient(c, data.t_s) for c in position.T], axis=-1)
    force = np.stack(
        [np.interp(data.t_s - offset_s, data.readings.t_s, c) for c in data.readings.force_m_s2.T], axis=-1
    )
    up = ((data.T[:, :3, :3] @ R) @ force[..., None])[..., 0].mean(axis=0)
    values = np.zeros(16)
    values[12:15] = -up / np.linalg.norm(up) * data.gravity_m_s2
    values[15] = offset_s
    return _State(data.T.copy(), velocity, se3.transform(R, np.zeros(3)), values)


def _interval_covariance(data: _Data, own: Integrals) -> FloatArray:
    """Return the covariances ``(k, 9, 9)`` of the integrals of white noise, for a constant force."""
    t, (gyro, force) = data.duration_s[:, None, None], np.square(data.noise)
    F = se3.skew(own.velocity / data.duration_s[:, None])
    FF = F @ np.swapaxes(F, 1, 2)
    eye = np.eye(3)
    C = np.empty((len(data.pairs), 9, 9))
    C[:, :3, :3] = gyro * t * eye
    C[:, :3, 3:6] = gyro * t**2 / 2.0 * F
    C[:, :3, 6:] = gyro * t**3 / 6.0 * F
    C[:, 3:6, 3:6] = force * t * eye + gyro * t**3 / 3.0 * FF
    C[:, 3:6, 6:] = force * t**2 / 2.0 * eye + gyro * t**4 / 8.0 * FF
    C[:, 6:, 6:] = force * t**3 / 3.0 * eye + gyro * t**5 / 20.0 * FF
    C[:, 3:6, :3], C[:, 6:, :3] = np.swapaxes(C[:, :3, 3:6], 1, 2), np.swapaxes(C[:, :3, 6:], 1, 2)
    C[:, 6:, 3:6] = np.swapaxes(C[:, 3:6, 6:], 1, 2)
    return C


def _interval_residuals(
    data: _Data, state: _State
) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray], Integrals]:
    """Return residuals ``(k, 9)``, Jacobians and integrals of the intervals.

    The residuals are those of rotation, velocity and position, rad, m/s and m. The Jacobians are those by the
    state at the start, by that at the end (``(k, 9, 9)`` each), and by ``PARAMETERS``, ``(k, 9, 16)``.
    """
    a, b, dt = data.pairs, data.pairs + 1, data.duration_s[:, None]
    at, bias = data.t_s[a] - state.offset_s, state.values[6:12]
    own = integrals(data.readings, at, data.duration_s, bias)
    by_own = derivatives(data.readings, at, data.duration_s, bias)
    gravity, lever = state.values[12:15], state.T_camera_imu[:3, 3]
    Rc_a, Rc_b = state.T[a, :3, :3], state.T[b, :3, :3]
    inverse_a = np.swapaxes(Rc_a @ state.T_camera_imu[:3, :3], 1, 2)
    inverse_b = np.swapaxes(Rc_b @ state.T_camera_imu[:3, :3], 1, 2)
    arm_a, arm_b = Rc_a @ lever, Rc_b @ lever
    dv = state.velocity[b] - state.velocity[a] - gravity * dt
    dp = (
        state.T[b, :3, 3] + arm_b - state.T[a, :3, 3] - arm_a - state.velocity[a] * dt - 0.5 * gravity * dt**2
    )
    rotation = se3.log_so3(np.swapaxes(own.rotation, 1, 2) @ inverse_a @ np.swapaxes(inverse_b, 1, 2))
    velocity = (inverse_a @ dv[..., None])[..., 0] - own.velocity
    position = (inverse_a @ dp[..., None])[..., 0] - own.position
    J_a, J_b, J_c = np.zeros((len(a), 9, 9)), np.zeros((len(a), 9, 9)), np.zeros((len(a), 9, 16))
    J_a[:, :3, 3:6], J_b[:, :3, 3:6] = -inverse_b, inverse_b
    J_a[:, 3:6, 3:6] = inverse_a @ se3.skew(dv)
    J_a[:, 3:6, 6:], J_b[:, 3:6, 6:] = -inverse_a, inverse_a
    J_a[:, 6:, :3], J_b[:, 6:, :3] = -inverse_a, inverse_a
    J_a[:, 6:, 3:6] = inverse_a @ (se3.skew(dp) + se3.skew(arm_a))
    J_b[:, 6:, 3:6] = -inverse_a @ se3.skew(arm_b)
    J_a[:, 6:, 6:] = -inverse_a * dt[..., None]
    J_c[:, :3, 3:6] = inverse_b @ (Rc_b - Rc_a)
    J_c[:, 3:6, 3:6] = inverse_a @ se3.skew(dv) @ Rc_a
    J_c[:, 6:, 3:6] = inverse_a @ se3.skew(dp) @ Rc_a
    J_c[:, 6:, :3] = inverse_a @ (Rc_b - Rc_a)
    J_c[:, 3:6, 12:15] = -inverse_a * dt[..., None]
    J_c[:, 6:, 12:15] = -0.5 * inverse_a * dt[..., None] ** 2
    J_c[:, :, 6:12] = -by_own[:, :, 1:]
    J_c[:, :, 15] = by_own[:, :, 0]
    return np.concatenate([rotation, velocity, position], axis=1), (J_a, J_b, J_c), own


def _pose_residuals(data: _Data, state: _State) -> FloatArray:
    """Return the differences ``(n, 6)`` of the poses from the measured ones, in the axes of the board."""
    rotation = se3.log_so3(state.T[:, :3, :3] @ np.swapaxes(data.T[:, :3, :3], 1, 2))
    return np.concatenate([state.T[:, :3, 3] - data.T[:, :3, 3], rotation], axis=1)


def _adjusted(data: _Data, state: _State) -> tuple[FloatArray, BoolArray, dict[str, float]]:
    """Adjust the state; return the covariance of the parameters, the used images and figures of the fit.

    Raises DegenerateGeometryError if the adjustment does not converge.
    """
    information = np.linalg.inv(data.covariance)
    is_used = np.ones(len(data.t_s), dtype=bool)
    covariance, fit = np.zeros((16, 16)), {}
    for _ in range(_ITERATIONS):
        errors = _pose_residuals(data, state)
        distance = np.sqrt(np.einsum("ni,nij,nj->n", errors, information, errors))
        is_used = distance < _GATE * max(1.0, float(np.median(distance)) / np.sqrt(5.35))
        weight = np.minimum(1.0, _HUBER_POSE / np.maximum(distance, 1e-12)) * np.where(is_used, 1.0, 1e-3)
        W = information * weight[:, None, None]
        residuals, (J_a, J_b, J_c), own = _interval_residuals(data, state)
        V = np.linalg.inv(_interval_covariance(data, own))
        between = np.sqrt(np.einsum("ni,nij,nj->n", residuals, V, residuals))
        V *= np.minimum(1.0, _HUBER_INTERVAL / np.maximum(between, 1e-12))[:, None, None]
        diagonal = np.zeros((len(data.t_s), 9, 9))
        diagonal[:, :6, :6] = W
        diagonal[:, range(6, 9), range(6, 9)] += 1e-2
        gradient = np.zeros((len(data.t_s), 9))
        gradient[:, :6] = (W @ errors[..., None])[..., 0]
        by_common = np.zeros((len(data.t_s), 9, 16))
        off_diagonal = np.zeros((len(data.t_s) - 1, 9, 9))
        for rows, J in ((data.pairs, J_a), (data.pairs + 1, J_b)):
            JV = np.swapaxes(J, 1, 2) @ V
            diagonal[rows] += JV @ J
            gradient[rows] += (JV @ residuals[..., None])[..., 0]
            by_common[rows] += JV @ J_c
        off_diagonal[data.pairs] = np.swapaxes(J_a, 1, 2) @ V @ J_b
        JV = np.swapaxes(J_c, 1, 2) @ V
        common, common_gradient = _with_prior(state, data.gravity_m_s2, JV, J_c, residuals)
        flat = by_common.reshape(-1, 16)
        solved = _solve_chain(diagonal, off_diagonal, np.column_stack([flat, gradient.reshape(-1)]))
        reduced = common - flat.T @ solved[:, :16]
        covariance = np.asarray(np.linalg.inv(0.5 * (reduced + reduced.T)), np.float64)
        step = -covariance @ (common_gradient - flat.T @ solved[:, 16])
        states = (-solved[:, 16] - solved[:, :16] @ step).reshape(-1, 9)
        scale = min(
            1.0, 0.3 / max(float(np.abs(step[3:6]).max()), float(np.abs(states[:, 3:6]).max()), 1e-12)
        )
        scale = min(scale, 0.01 / max(abs(float(step[15])), 1e-12))
        state.move(scale * states, scale * step)
        freedom = max(6 * len(data.t_s) + 9 * len(data.pairs) - 9 * len(data.t_s) - 16, 1)
        squares = float(
            (weight * distance**2).sum() + np.minimum(between**2, _HUBER_INTERVAL * between).sum()
        )
        fit = {
            "rms_deg": float(np.rad2deg(np.sqrt((residuals[:, :3] ** 2).sum(axis=1).mean()))),
            "rms_m": float(np.sqrt((errors[is_used, :3] ** 2).sum(axis=1).mean())),
            "variance_ratio": squares / freedom,
        }
        fit["last_step_sigma"] = _step_sigma(data, state, step, covariance)
        if fit["last_step_sigma"] < _CONVERGED_SIGMA:
            break
    if not fit["last_step_sigma"] < _LARGEST_STEP_SIGMA:
        raise DegenerateGeometryError(
            f"the adjustment did not converge: the last of {_ITERATIONS} steps was "
            f"{fit['last_step_sigma']:.2g} standard deviations, expected less than {_LARGEST_STEP_SIGMA:g}; "
            "check the calibration of the camera and the units of the readings, and move about all axes",
            ("motion",),
        )
    return covariance * max(1.0, fit["variance_ratio"]), is_used, fit


def _step_sigma(data: _Data, state: _State, step: FloatArray, covariance: FloatArray) -> float:
    """Return the largest step of a parameter in its standard deviations.

    The position along the axis of a rotation about one axis only is left out: it is not determined, so that
    it does not converge.
    """
    axis, spread = _rotation_axis(data.readings)
    step = step.copy()
    if spread < _LEAST_SPREAD:
        along = state.T_camera_imu[:3, :3] @ axis
        step[:3] -= along * float(along @ step[:3])
    return float(np.abs(step / np.sqrt(np.diag(covariance))).max())


def _with_prior(
    state: _State, gravity_m_s2: float, JV: FloatArray, J: FloatArray, residuals: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return information ``(16, 16)`` and gradient ``(16,)`` of the common parameters with the priors."""
    information = (JV @ J).sum(axis=0) + _PRIOR
    gradient = (JV @ residuals[..., None])[..., 0].sum(axis=0)
    gradient[6:12] += np.diag(_PRIOR)[6:12] * state.values[6:12]
    gradient[:3] += np.diag(_PRIOR)[:3] * state.T_camera_imu[:3, 3]
    length = float(np.linalg.norm(state.values[12:15]))
    direction = state.values[12:15] / length
    information[12:15, 12:15] += np.outer(direction, direction) / _GRAVITY_SIGMA**2
    gradient[12:15] += direction * (length - gravity_m_s2) / _GRAVITY_SIGMA**2
    return information, gradient


def _solve_chain(diagonal: FloatArray, off_diagonal: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution of a symmetric block-tridiagonal system of ``(n, 9, 9)`` and ``(n - 1, 9, 9)``."""
    n = len(diagonal)
    banded = np.zeros((18, 9 * n))
    for i in range(9):
        for j in range(9):
            if i <= j:
                banded[17 + i - j, j::9] = diagonal[:, i, j]
            banded[8 + i - j, 9 + j :: 9] = off_diagonal[:, i, j]
    return np.asarray(solveh_banded(banded, right, check_finite=False))


def _result(
    data: _Data,
    state: _State,
    covariance: FloatArray,
    is_used: BoolArray,
    fit: dict[str, float],
    dropped: int,
) -> RelativePose:
    """Return the pose with figures and the assessment."""
    sigma = np.sqrt(np.diag(covariance))
    figures = {"time_offset_s": state.offset_s, "time_offset_sigma_s": float(sigma[15])}
    for k, name in enumerate(PARAMETERS[6:12], start=6):
        figures[name] = float(state.values[k])
    figures |= {"gyro_bias_sigma_rad_s": float(sigma[6:9].max())}
    figures |= {"accelerometer_bias_sigma_m_s2": float(sigma[9:12].max())}
    figures |= {"gyro_noise_rad_s_sqrt_hz": float(data.noise[0])}
    figures |= {"accelerometer_noise_m_s2_sqrt_hz": float(data.noise[1])} | fit
    pose = np.asarray(covariance[:6, :6])
    return RelativePose(
        UncertainTransform(state.T_camera_imu, 0.5 * (pose + pose.T)),
        undetermined_directions(pose),
        tuple(_sentences(data, pose, float(sigma[15]), fit, dropped)),
        int(is_used.sum()),
        dropped,
        figures,
    )


def _rotation_axis(readings: Readings) -> tuple[FloatArray, float]:
    """Return the axis of the largest rates, and the ratio of the second largest rates to them."""
    rates = readings.rate_rad_s - np.median(readings.rate_rad_s, axis=0)
    values, vectors = np.linalg.eigh(rates.T @ rates / len(rates))
    return vectors[:, 2], float(np.sqrt(max(values[1], 0.0) / max(values[2], 1e-12)))


def _sentences(
    data: _Data, covariance: FloatArray, offset_sigma_s: float, fit: dict[str, float], dropped: int
) -> list[str]:
    """Return the assessment."""
    sentences = []
    missing = undetermined_directions(covariance)
    if _rotation_axis(data.readings)[1] < _LEAST_SPREAD:
        sentences.append("camera and IMU rotate about one axis: rotate them about a second axis, too")
    if {"x", "y", "z"} & set(missing):
        names = ", ".join(name for name in missing if name in "xyz")
        sentences.append(f"{names} not determined: rotate faster, about all axes, and take more images")
    if {"roll", "pitch", "yaw"} & set(missing):
        names = ", ".join(name for name in missing if name not in "xyz")
        sentences.append(f"{names} not determined: rotate about all axes")
    if offset_sigma_s > _OFFSET_LIMIT_S:
        sentences.append(
            "the offset of the clocks is not determined to 1 ms: change the rotation more quickly"
        )
    if fit["variance_ratio"] > 4.0:
        sentences.append(
            f"the residuals are {np.sqrt(fit['variance_ratio']):.1f} times as large as stated: check the "
            "calibration of the camera, motion blur, rolling shutter, and that both are rigidly connected"
        )
    if dropped > _DROPPED_PART * (len(data.t_s) + dropped):
        sentences.append(f"{dropped} images contradict the others and the IMU, and are not used")
    return sentences or ["good: all directions are determined"]
