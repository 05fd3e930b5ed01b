# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Error-state filter: prediction by the IMU, correction by increments of odometries and by absolute poses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import (
    inverse_covariance,
    pose_error,
    rotate_covariance,
    symmetrised,
)
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.kalman_correction.interface import KalmanCorrectionInputs
from cdff_core.dfns.kalman_prediction.interface import KalmanPredictionInputs
from cdff_core.dfns.odometry_increment.interface import OdometryIncrementInputs
from cdff_core.dfns.pose_weighting.interface import PoseWeightingInputs
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimate import MOUNTS, POSE, SLIP, TIMELINE_ERRORS, Clone, Estimate
from cdff_core.dfpcs.position_manager.frame_tree import RobotFrames
from cdff_core.dfpcs.position_manager.imu_buffer import ImuBuffer
from cdff_core.dfpcs.position_manager.innovation_statistics import REFUSED_RATIO, adapted_factor
from cdff_core.dfpcs.position_manager.mount_errors import (
    MountErrors,
    corrected_mount,
    increment_jacobian,
    offset_displacement,
    with_imu_mount_error,
    with_stamp_offset,
)
from cdff_core.dfpcs.position_manager.wheel_correction import corrected_by_wheels, kalman_corrected

#: Ports whose measurements are relative to the origin of an odometry, and ports of absolute poses.
ODOMETRIES = ("odometry", "visual_odometry", "lidar_odometry")
FIXES = ("fix", "absolute_fix")
#: Standard deviation of an unknown velocity (without IMU, or after refused increments): that of a car.
UNKNOWN_SPEED_SIGMA_M_S = 15.0
#: Time constant of slip; speed of the wheel odometry above which its origin was reset.
_SLIP_TIME_S, _MAX_WHEEL_SPEED_M_S = 6.0, 5.0
#: Longest step of the strapdown integration, nanoseconds.
_STEP_NS = 200_000_000
#: Bounds after a silence on the standard deviations of position (numerical precision) and rotation (unknown).
_LOST_M, _LOST_RAD = 1e4, math.pi / math.sqrt(3.0)
#: Factor on the variances of an increment for each refused increment that it contains, and the number of
#: refusals beyond which they do not grow.
_REFUSAL_SCALE, _MAX_SCALED_REFUSALS = 4.0, 10
#: Standard deviation of an increment of an odometry without covariance.
_UNSTATED_SIGMA = np.array([0.02] * 3 + [0.005] * 3)
#: Number and duration (s) of consecutive refused increments after which the velocity counts as unknown. A
#: slip of the wheels refuses several increments of a frequent source but does not change the velocity.
_MAX_REFUSALS, _MIN_REFUSED_S = 3, 1.0
_IDENTITY = UncertainTransform.identity()
_JITTER = 1e-14 * np.eye(6)


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """Measurement of one source at one time."""

    stamp_ns: int
    source: str  # input port; a measurement of ``imu`` is only a time at which to estimate
    T_origin_sensor: UncertainTransform = _IDENTITY
    frame: str = ""  # frame of the origin
    child: str = ""  # frame of the sensor
    scale: float = 1.0  # factor on its variances
    #: True if no increment may be formed, since the previous pose is missing or has another origin.
    restart: bool = False
    #: Standard deviation of the offset of its stamp to the clock of the IMU, seconds.
    stamp_sigma_s: float = 0.0


@dataclass(frozen=True, slots=True)
class MeasurementResult:
    """Result of a measurement: used, only cloned (the next increment starts there), or refused."""

    used: bool
    reasons: tuple[str, ...] = ()

    @property
    def is_refused(self) -> bool:
        """True if the measurement contradicted the estimate."""
        return any("_refused" in reason for reason in self.reasons)


class Estimator:
    """Computes the next estimate from an estimate and a measurement; its only state is gravity."""

    def __init__(
        self,
        config: PositionManagerConfig,
        dfn: Callable[[str], Dfn[Any, Any, Any]],
        imu: ImuBuffer,
        frames: RobotFrames,
    ) -> None:
        self._config, self._imu, self._frames = config, imu, frames
        self._mounts = MountErrors(config.mounts, frames)
        self._prediction, self._correction = dfn("prediction"), dfn("correction")
        self._fix_correction, self._weighting = dfn("fix_correction"), dfn("weighting")
        self._increments = {
            "odometry": dfn("wheel_increment"),
            "visual_odometry": dfn("visual_increment"),
            "lidar_odometry": dfn("lidar_increment"),
        }
        #: Strength of gravity, m/s^2; None until it was measured.
        self.gravity_m_s2: float | None = None

    def update(self, estimate: Estimate, measurement: Measurement) -> tuple[Estimate, MeasurementResult]:
        """Predict to the time of a measurement and correct by it."""
        if measurement.stamp_ns > estimate.stamp_ns:
            estimate = replace(estimate, cross_covariance=estimate.covariance[:, TIMELINE_ERRORS])
        estimate = self._predict(estimate, measurement.stamp_ns)
        if measurement.source == "imu":
            return estimate, MeasurementResult(True)
        if measurement.source in FIXES:
            return self._correct_by_fix(estimate, measurement)
        return self._correct_by_increment(estimate, measurement)

    def extrapolate(self, estimate: Estimate, stamp_ns: int) -> Estimate:
        """Return the estimate predicted to a later time, with its correlation with the given one."""
        return self._predict(
            replace(estimate, cross_covariance=estimate.covariance[:, TIMELINE_ERRORS]), stamp_ns
        )

    def _predict(self, estimate: Estimate, stamp_ns: int) -> Estimate:
        if stamp_ns - estimate.stamp_ns > self._config.clock.max_silence_s * 1e9:
            return self._predict_over_silence(estimate, stamp_ns)
        while estimate.stamp_ns < stamp_ns:
            estimate = self._integrate(estimate, min(stamp_ns, estimate.stamp_ns + _STEP_NS))
        return estimate

    def _predict_over_silence(self, estimate: Estimate, end_ns: int) -> Estimate:
        """Predict in one step: the robot is assumed to be at rest, and its pose becomes nearly unknown."""
        previous = estimate.covariance[POSE, POSE]
        at_rest = replace(estimate, velocity=np.zeros(3)).with_velocity_sigma(0.0)
        predicted = self._integrate(at_rest, end_ns)
        P = predicted.covariance.copy()
        lost = np.diag(np.square([_LOST_M] * 3 + [_LOST_RAD] * 3))
        P[POSE, POSE] = previous + np.minimum(P[POSE, POSE] - previous, lost)
        return replace(predicted, covariance=P).with_velocity_sigma(UNKNOWN_SPEED_SIGMA_M_S)

    def _integrate(self, estimate: Estimate, end_ns: int) -> Estimate:
        """Integrate the IMU readings to a time (prediction)."""
        stamps, forces, rates = self._imu.around(estimate.stamp_ns, end_ns)
        force_noise, rate_noise = self._imu.noise(end_ns)
        R = se3.exp_so3(estimate.mount_error("imu"))
        out = self._prediction.process(
            KalmanPredictionInputs(
                pose=estimate.pose,
                velocity=estimate.velocity,
                biases=estimate.biases,
                covariance=estimate.covariance,
                interval_ns=np.array([estimate.stamp_ns, end_ns]),
                stamps_ns=stamps,
                specific_force=forces @ R.T,
                rates_rad_s=rates @ R.T,
                gravity=self.gravity_m_s2,
                lever_m=self._imu.lever_m,
                force_noise=force_noise,
                rate_noise=rate_noise,
            )
        )
        # First-order Gauss-Markov process of slip.
        decay = math.exp(-(end_ns - estimate.stamp_ns) * 1e-9 / _SLIP_TIME_S)
        P, cross = out.covariance, estimate.cross_covariance.copy()
        P[SLIP] *= decay
        P[:, SLIP] *= decay
        P[range(15, 18), range(15, 18)] += np.square(self._config.wheels.slip_sigma) * (1.0 - decay**2)
        cross[:15] = out.transition @ cross[:15]
        cross[SLIP] *= decay
        predicted = replace(
            estimate,
            stamp_ns=end_ns,
            pose=out.pose,
            velocity=out.velocity,
            slip=estimate.slip * decay,
            covariance=P,
            cross_covariance=cross,
        )
        return with_imu_mount_error(estimate, predicted, self.gravity_m_s2) if out.inertial else predicted

    def _correct_by_increment(self, estimate: Estimate, m: Measurement) -> tuple[Estimate, MeasurementResult]:
        """Correct by the increment since the source's clone, then clone the pose.

        After a refusal the clone is kept, so that the next increment contains the refused one.
        """
        clone = estimate.clones.get(m.source)
        if clone is None or m.restart or self._is_origin_lost(m, clone):
            estimate = with_stamp_offset(estimate, m.source, m.stamp_sigma_s)
            attached = self._mounts.attached(
                estimate.with_clone(m.source, m.T_origin_sensor), m.source, m.child
            )
            return attached, MeasurementResult(False, (f"{m.source}_attached",))
        if estimate.consecutive_refusals >= _MAX_REFUSALS:
            used_ns = min(
                (c.stamp_ns for c in estimate.clones.values() if c.refusals), default=clone.stamp_ns
            )
            interval_s = (m.stamp_ns - used_ns) * 1e-9
            if interval_s >= _MIN_REFUSED_S:
                estimate = estimate.with_velocity_sigma(UNKNOWN_SPEED_SIGMA_M_S, interval_s)
        factor = clone.noise_factor * _REFUSAL_SCALE ** min(clone.refusals, _MAX_SCALED_REFUSALS)
        try:
            corrected = self._apply_increment(estimate, replace(m, scale=m.scale * factor), clone)
        except RefusedError as error:
            refused = replace(estimate, consecutive_refusals=estimate.consecutive_refusals + 1)
            noise_factor = adapted_factor(clone.noise_factor, REFUSED_RATIO)
            return refused.with_refusal(m.source).with_noise_factor(
                m.source, noise_factor
            ), MeasurementResult(False, (f"{m.source}_refused", *error.reasons))
        noise_factor = adapted_factor(clone.noise_factor, corrected.innovation_ratio)
        corrected = corrected.with_noise_factor(m.source, noise_factor)
        return replace(corrected, consecutive_refusals=0), MeasurementResult(True)

    def _is_origin_lost(self, m: Measurement, clone: Clone) -> bool:
        """Return whether the origin of a source may have changed: it was silent, or its wheels moved too far.

        Silence of the wheel odometry does not matter, since its origin remains the same.
        """
        elapsed_s = (m.stamp_ns - clone.stamp_ns) * 1e-9
        if m.source != "odometry":
            return elapsed_s > self._config.odometry.max_gap_s
        moved_m = float(np.linalg.norm(m.T_origin_sensor.matrix[:3, 3] - clone.measured.matrix[:3, 3]))
        return moved_m > _MAX_WHEEL_SPEED_M_S * elapsed_s

    def _apply_increment(self, estimate: Estimate, m: Measurement, clone: Clone) -> Estimate:
        """Correct by an increment; raises RefusedError if it contradicts the estimate."""
        current, previous = m.T_origin_sensor, clone.measured
        mount = self._frames.mount(m.child, m.stamp_ns)
        if m.source in MOUNTS:
            mount = corrected_mount(estimate, m.source, mount)
        step = self._increments[m.source].process(
            OdometryIncrementInputs(
                first=previous.matrix,
                second=current.matrix,
                mount=mount,
                first_covariance=previous.covariance,
                second_covariance=current.covariance,
            )
        )
        if m.source == "odometry":
            return corrected_by_wheels(
                estimate,
                self._correction,
                m.T_origin_sensor,
                step,
                m.scale,
                has_imu=self._imu.has_readings(clone.stamp_ns, m.stamp_ns),
            )
        expected, H = estimate.relative_motion(m.source)
        residual = pose_error(step.increment, expected)
        noise = step.covariance * m.scale
        if current.covariance is None or previous.covariance is None:
            noise = np.diag(np.square(_UNSTATED_SIGMA))
        if m.source in self._config.odometry.correlated:
            # Covariance intersection with equal weights multiplies the variances of k sources by k.
            noise = noise * self._count_correlated(estimate, m)
        J = increment_jacobian(step.increment, mount[:3, 3])
        H[:, MOUNTS[m.source]] = -J[:, 3:]
        residual[:3] -= offset_displacement(estimate, m.source, H)
        noise = noise + J[:, :3] @ self._mounts.covariance(m.child, m.stamp_ns)[:3, :3] @ J[:, :3].T
        corrected = kalman_corrected(estimate, self._correction, residual, H, noise)
        return corrected.with_clone(m.source, m.T_origin_sensor)

    def _count_correlated(self, estimate: Estimate, m: Measurement) -> int:
        """Return the number of odometries with common errors that measure the motion of this measurement.

        A source counts if its clone is recent, so that the order of arrival has no effect.
        """
        since_ns = m.stamp_ns - int(self._config.odometry.max_gap_s * 1e9)
        others = {*self._config.odometry.correlated} - {m.source}
        return 1 + sum(s in estimate.clones and estimate.clones[s].stamp_ns >= since_ns for s in others)

    def _correct_by_fix(self, estimate: Estimate, m: Measurement) -> tuple[Estimate, MeasurementResult]:
        """Correct by an absolute pose; the first pose in an unknown frame locates that frame in the site."""
        if m.T_origin_sensor.covariance is None:
            return estimate, MeasurementResult(False, ("fix_refused", "no_covariance"))
        mount, mount_covariance = (
            self._frames.mount(m.child, m.stamp_ns),
            self._mounts.covariance(m.child, m.stamp_ns),
        )
        T = m.T_origin_sensor @ UncertainTransform.exact(se3.inverse(mount))
        noise = np.asarray(T.covariance) * m.scale
        T_site_frame = self._frames.site_pose(m.frame)
        if T_site_frame is not None:
            measured, expected = T_site_frame @ T.matrix, estimate.pose
            noise = rotate_covariance(noise, T_site_frame[:3, :3])
            R = T_site_frame[:3, :3] @ m.T_origin_sensor.matrix[:3, :3]
            noise = noise + rotate_covariance(inverse_covariance(mount, mount_covariance), R)
            H = np.eye(6, len(estimate.covariance))
        else:
            name = f"frame:{m.frame}"
            if name not in estimate.clones:
                return estimate.with_clone(name, T), MeasurementResult(False, ("fix_attached",))
            first = estimate.clones[name].measured.matrix
            measured = se3.inverse(first) @ T.matrix
            J = increment_jacobian(measured, mount[:3, 3])
            noise = rotate_covariance(noise, first[:3, :3].T) + J @ mount_covariance @ J.T
            expected, H = estimate.relative_motion(name)
        residual, is_relative = pose_error(measured, expected), T_site_frame is None
        try:
            if self._config.fixes.weighting == "kalman":
                corrected = kalman_corrected(
                    estimate, self._fix_correction, residual, H, noise, is_relative=is_relative
                )
            else:
                corrected = self._intersect(
                    estimate, expected, measured, residual, H, noise, is_relative=is_relative
                )
        except RefusedError as error:
            return estimate, MeasurementResult(False, ("fix_refused", *error.reasons))
        return corrected, MeasurementResult(True)

    def _intersect(
        self,
        estimate: Estimate,
        expected: FloatArray,
        measured: FloatArray,
        residual: FloatArray,
        H: FloatArray,
        noise: FloatArray,
        *,
        is_relative: bool,
    ) -> Estimate:
        """Correct by covariance intersection of the measured pose; other errors follow by correlation."""
        P = estimate.covariance
        PH = P @ H.T
        S = symmetrised(H @ PH)
        # Only the gate of this correction is used: it refuses a fix that contradicts the estimate.
        self._fix_correction.process(
            KalmanCorrectionInputs(residual=residual, jacobian=np.eye(6), noise=noise, covariance=S)
        )
        joined = self._weighting.process(
            PoseWeightingInputs(first=expected, first_covariance=S, second=measured, second_covariance=noise)
        )
        if joined.weight >= 1.0:
            return estimate
        G = np.linalg.solve(S + _JITTER, PH.T).T
        W = joined.covariance @ ((1.0 - joined.weight) * np.linalg.inv(noise + _JITTER))
        covariance = P - G @ PH.T + G @ joined.covariance @ G.T
        K = G @ W
        return estimate.corrected(K @ residual, covariance, K @ H, is_relative=is_relative)
