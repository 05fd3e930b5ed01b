# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Error-state filter: prediction by the IMU, correction by increments of odometries and by absolute poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimate import TIMELINE_ERRORS, Estimate
from cdff_core.dfpcs.position_manager.fix_correction import FixCorrection
from cdff_core.dfpcs.position_manager.frame_tree import RobotFrames
from cdff_core.dfpcs.position_manager.imu_buffer import ImuBuffer
from cdff_core.dfpcs.position_manager.increment_correction import IncrementCorrection
from cdff_core.dfpcs.position_manager.measurement import FIXES, Measurement, MeasurementResult
from cdff_core.dfpcs.position_manager.motion_prediction import MotionPrediction


class Estimator:
    """Computes the next estimate from an estimate and a measurement; its only state is gravity."""

    def __init__(
        self,
        config: PositionManagerConfig,
        dfn: Callable[[str], Dfn[Any, Any, Any]],
        imu: ImuBuffer,
        frames: RobotFrames,
    ) -> None:
        self._motion = MotionPrediction(config, dfn("prediction"), imu)
        self._by_increment = IncrementCorrection(config, dfn, imu, frames)
        self._by_fix = FixCorrection(config, dfn, frames)

    @property
    def gravity_m_s2(self) -> float | None:
        """Strength of gravity, m/s^2; None until it was measured."""
        return self._motion.gravity_m_s2

    @gravity_m_s2.setter
    def gravity_m_s2(self, value: float | None) -> None:
        self._motion.gravity_m_s2 = value

    def update(self, estimate: Estimate, measurement: Measurement) -> tuple[Estimate, MeasurementResult]:
        """Predict to the time of a measurement and correct by it."""
        if measurement.stamp_ns > estimate.stamp_ns:
            estimate = replace(estimate, cross_covariance=estimate.covariance[:, TIMELINE_ERRORS])
        estimate = self._motion.predict(estimate, measurement.stamp_ns)
        if measurement.source == "imu":
            return estimate, MeasurementResult(True)
        if measurement.source in FIXES:
            return self._by_fix.correct(estimate, measurement)
        return self._by_increment.correct(estimate, measurement)

    def extrapolate(self, estimate: Estimate, stamp_ns: int) -> Estimate:
        """Return the estimate predicted to a later time, with its correlation with the given one."""
        return self._motion.predict(
            replace(estimate, cross_covariance=estimate.covariance[:, TIMELINE_ERRORS]), stamp_ns
        )
