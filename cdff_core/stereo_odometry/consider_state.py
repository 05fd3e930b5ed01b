# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transforms with correlated errors, as in Schmidt's consider filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry import covariance as cov
from cdff_common.geometry.se3 import FloatArray
from cdff_core.dfns.stereo_motion_estimation.interface import StereoMotionEstimationOutputs

#: Number of errors common to all points: 6 of tracking (offsets of columns, rows and disparities,
#: magnification, stretch, rotation) and 8 of the calibration (``CalibrationUncertainty``).
COMMON = 14


@dataclass(frozen=True, slots=True, eq=False)
class ConsiderState:
    """Transform whose error is independent noise plus the effect of errors common to all motions.

    If the errors of motions were independent, the standard deviation of a path would grow with the square
    root of the number of keyframes. But errors common to all points of a pair (pixel locking, perspective of
    patches on the ground) and errors of the calibration recur in every keyframe, so that they add up
    linearly. Their covariance is considered without estimating them [1]_, except for the calibration: a later
    estimate of it corrects the path.

    References
    ----------
    .. [1] S. F. Schmidt, Application of State-Space Methods to Navigation Problems, Advances in Control
       Systems 3, 1966, doi:10.1016/B978-1-4831-6716-9.50011-4
    """

    matrix: FloatArray  # (4, 4)
    noise: FloatArray  # (6, 6), covariance of the independent part
    #: (6, COMMON + k), derivatives with respect to the common errors (of unit variance) and to k parameters
    #: of the calibration (pixels).
    response: FloatArray

    @classmethod
    def independent(cls, pose: UncertainTransform, parameters: int) -> ConsiderState:
        """Return a pose without common errors."""
        noise = np.zeros((6, 6)) if pose.covariance is None else pose.covariance
        return cls(pose.matrix, noise, np.zeros((6, COMMON + parameters)))

    @classmethod
    def from_motion(cls, refined: StereoMotionEstimationOutputs) -> ConsiderState:
        """Return the state of an estimated motion."""
        response = np.hstack([refined.common_response, refined.calibration_response])
        return cls(refined.motion, refined.noise_covariance, response)

    def __matmul__(self, motion: ConsiderState) -> ConsiderState:
        """Return ``T_a_c = T_a_b @ T_b_c``; the effects of common errors are added."""
        J1, J2 = cov.compose_jacobians(self.matrix, motion.matrix)
        noise = J1 @ self.noise @ J1.T + J2 @ motion.noise @ J2.T
        response = J1 @ self.response + J2 @ motion.response
        return ConsiderState(self.matrix @ motion.matrix, cov.symmetrised(noise), response)

    def with_calibration_change(self, change_px: FloatArray) -> ConsiderState:
        """Return the pose corrected for a change (k,) of the calibration estimate."""
        return ConsiderState(self._perturb(self.response[:, COMMON:] @ change_px), self.noise, self.response)

    def fused(self, other: ConsiderState) -> ConsiderState:
        """Return the mean with another estimate of the same transform, weighted by the independent noise."""
        gain = np.linalg.solve((self.noise + other.noise).T, self.noise.T).T
        matrix = self._perturb(gain @ cov.pose_error(other.matrix, self.matrix))
        noise = cov.symmetrised(self.noise - gain @ self.noise)
        return ConsiderState(matrix, noise, self.response + gain @ (other.response - self.response))

    def to_transform(self, calibration_covariance: FloatArray) -> UncertainTransform:
        """Return the transform with its total covariance, given the covariance (k, k) of the calibration."""
        common, calibration = self.response[:, :COMMON], self.response[:, COMMON:]
        correlated = common @ common.T + calibration @ calibration_covariance @ calibration.T
        return UncertainTransform(self.matrix, self.noise + cov.symmetrised(correlated))

    def _perturb(self, error: FloatArray) -> FloatArray:
        """Return the pose (4, 4) after applying a pose error (6,)."""
        return se3.transform(se3.exp_so3(error[3:]) @ self.matrix[:3, :3], self.matrix[:3, 3] + error[:3])
