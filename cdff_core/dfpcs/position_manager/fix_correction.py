# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correction by absolute poses, as independent measurements or by covariance intersection."""

from __future__ import annotations

from collections.abc import Callable
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
from cdff_core.dfns.pose_weighting.interface import PoseWeightingInputs
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimate import Estimate
from cdff_core.dfpcs.position_manager.frame_tree import RobotFrames
from cdff_core.dfpcs.position_manager.measurement import Measurement, MeasurementResult
from cdff_core.dfpcs.position_manager.mount_errors import MountErrors, increment_jacobian
from cdff_core.dfpcs.position_manager.wheel_correction import kalman_corrected

#: Variance that makes singular covariances invertible.
_JITTER = 1e-14 * np.eye(6)


class FixCorrection:
    """Corrects estimates by absolute poses; a pose that contradicts the estimate is refused."""

    def __init__(
        self, config: PositionManagerConfig, dfn: Callable[[str], Dfn[Any, Any, Any]], frames: RobotFrames
    ) -> None:
        self._config, self._frames = config, frames
        self._mounts = MountErrors(config.mounts, frames)
        self._correction, self._weighting = dfn("fix_correction"), dfn("weighting")

    def correct(self, estimate: Estimate, m: Measurement) -> tuple[Estimate, MeasurementResult]:
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
            T_measured, T_expected = T_site_frame @ T.matrix, estimate.pose
            noise = rotate_covariance(noise, T_site_frame[:3, :3])
            R = T_site_frame[:3, :3] @ m.T_origin_sensor.matrix[:3, :3]
            noise = noise + rotate_covariance(inverse_covariance(mount, mount_covariance), R)
            H = np.eye(6, len(estimate.covariance))
        else:
            name = f"frame:{m.frame}"
            if name not in estimate.clones:
                return estimate.with_clone(name, T), MeasurementResult(False, ("fix_attached",))
            first = estimate.clones[name].measured.matrix
            T_measured = se3.inverse(first) @ T.matrix
            J = increment_jacobian(T_measured, mount[:3, 3])
            noise = rotate_covariance(noise, first[:3, :3].T) + J @ mount_covariance @ J.T
            T_expected, H = estimate.relative_motion(name)
        residual, is_relative = pose_error(T_measured, T_expected), T_site_frame is None
        try:
            if self._config.fixes.weighting == "kalman":
                corrected = kalman_corrected(
                    estimate, self._correction, residual, H, noise, is_relative=is_relative
                )
            else:
                corrected = self._intersect(
                    estimate, T_expected, T_measured, residual, H, noise, is_relative=is_relative
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
        self._correction.process(
            KalmanCorrectionInputs(residual=residual, jacobian=np.eye(6), noise=noise, covariance=S)
        )
        weighting = self._weighting.process(
            PoseWeightingInputs(first=expected, first_covariance=S, second=measured, second_covariance=noise)
        )
        if weighting.weight >= 1.0:
            return estimate
        G = np.linalg.solve(S + _JITTER, PH.T).T
        W = weighting.covariance @ ((1.0 - weighting.weight) * np.linalg.inv(noise + _JITTER))
        covariance = P - G @ PH.T + G @ weighting.covariance @ G.T
        K = G @ W
        return estimate.corrected(K @ residual, covariance, K @ H, is_relative=is_relative)
