# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correction by increments of odometries, between the cloned pose of a source and the current pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from cdff_common.errors import RefusedError
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.odometry_increment.interface import OdometryIncrementInputs
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimate import MOUNTS, Clone, Estimate
from cdff_core.dfpcs.position_manager.frame_tree import RobotFrames
from cdff_core.dfpcs.position_manager.imu_buffer import ImuBuffer
from cdff_core.dfpcs.position_manager.innovation_statistics import REFUSED_RATIO, adapted_factor
from cdff_core.dfpcs.position_manager.measurement import Measurement, MeasurementResult
from cdff_core.dfpcs.position_manager.motion_prediction import UNKNOWN_SPEED_SIGMA_M_S
from cdff_core.dfpcs.position_manager.mount_errors import (
    MountErrors,
    corrected_mount,
    increment_jacobian,
    offset_displacement,
    with_stamp_offset,
)
from cdff_core.dfpcs.position_manager.wheel_correction import corrected_by_wheels, kalman_corrected

#: Speed of the wheel odometry above which its origin was reset.
_MAX_WHEEL_SPEED_M_S = 5.0
#: Factor on the variances of an increment for each refused increment that it contains, and the number of
#: refusals beyond which they do not grow.
_REFUSAL_SCALE, _MAX_SCALED_REFUSALS = 4.0, 10
#: Standard deviation of an increment of an odometry without covariance.
_UNSTATED_SIGMA = np.array([0.02] * 3 + [0.005] * 3)
#: Number and duration (s) of consecutive refused increments after which the velocity counts as unknown. A
#: slip of the wheels refuses several increments of a frequent source but does not change the velocity.
_MAX_REFUSALS, _MIN_REFUSED_S = 3, 1.0


class IncrementCorrection:
    """Corrects estimates by increments; an increment that contradicts the estimate is refused."""

    def __init__(
        self,
        config: PositionManagerConfig,
        dfn: Callable[[str], Dfn[Any, Any, Any]],
        imu: ImuBuffer,
        frames: RobotFrames,
    ) -> None:
        self._config, self._imu, self._frames = config, imu, frames
        self._mounts = MountErrors(config.mounts, frames)
        self._sensor_frames: dict[str, str] = {}
        self._correction = dfn("correction")
        self._increments = {
            "odometry": dfn("wheel_increment"),
            "visual_odometry": dfn("visual_increment"),
            "lidar_odometry": dfn("lidar_increment"),
        }

    def correct(self, estimate: Estimate, m: Measurement) -> tuple[Estimate, MeasurementResult]:
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
        if m.source in MOUNTS:
            self._sensor_frames[m.source] = m.child
        if self._imu.T_base_imu is not None:
            self._sensor_frames["imu"] = self._frames.imu
        reasons = self._mounts.deviations(corrected, self._sensor_frames)
        return replace(corrected, consecutive_refusals=0), MeasurementResult(True, reasons)

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
