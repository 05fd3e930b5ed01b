# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses whose errors are linked: part of what one key frame is off by, the next is off by too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry import covariance as cov
from cdff_common.geometry.se3 import FloatArray
from cdff_core.dfns.stereo_motion_estimation._interface import StereoMotionEstimationOutputs

#: Shifts of columns, rows and disparities, a magnification and a stretch: the first entries of what is shared.
COMMON = 5


@dataclass(frozen=True, slots=True, eq=False)
class LinkedPose:
    """A transform whose error is ``noise`` of its own plus ``response`` times errors shared along the whole way.

    Composed as if every motion were independent, the covariance of a way would grow with the root of the number of key
    frames. What all of a pair's points share (pixel locking, the perspective of patches on the ground ahead) and what
    is unknown of the calibration come back in every key frame and add up in proportion to it. Shared errors are
    therefore considered along the way without being estimated [1]_, the calibration with its estimate: what is learnt
    of it later corrects the way that lies behind.

    Attributes
    ----------
    matrix : array, shape (4, 4)
    noise : array, shape (6, 6)
        Covariance of the part that is its own.
    response : array, shape (6, COMMON + k)
        Derivatives by the shared errors: common ones of unit variance, then k parameters of the calibration, pixels.

    References
    ----------
    .. [1] S. F. Schmidt, Application of State-Space Methods to Navigation Problems, Advances in Control Systems 3,
       1966, doi:10.1016/B978-1-4831-6716-9.50011-4
    """

    matrix: FloatArray
    noise: FloatArray
    response: FloatArray

    @classmethod
    def unlinked(cls, pose: UncertainTransform, parameters: int) -> LinkedPose:
        """A pose that shares nothing with what comes after it."""
        noise = np.zeros((6, 6)) if pose.covariance is None else pose.covariance
        return cls(pose.matrix, noise, np.zeros((6, COMMON + parameters)))

    @classmethod
    def of_motion(cls, refined: StereoMotionEstimationOutputs) -> LinkedPose:
        """An estimated motion."""
        response = np.hstack([refined.common_response, refined.calibration_response])
        return cls(refined.motion, refined.noise_covariance, response)

    def __matmul__(self, motion: LinkedPose) -> LinkedPose:
        """``T_a_c = T_a_b @ T_b_c``."""
        J1, J2 = cov.compose_jacobians(self.matrix, motion.matrix)
        noise = J1 @ self.noise @ J1.T + J2 @ motion.noise @ J2.T
        return LinkedPose(
            self.matrix @ motion.matrix, 0.5 * (noise + noise.T), J1 @ self.response + J2 @ motion.response
        )

    def corrected(self, calibration_change: FloatArray) -> LinkedPose:
        """The pose after the calibration (k,) turned out to be another than it was made with."""
        off = self.response[:, COMMON:] @ calibration_change
        T = se3.transform(se3.exp_so3(off[3:]) @ self.matrix[:3, :3], self.matrix[:3, 3] + off[:3])
        return LinkedPose(T, self.noise, self.response)

    def fused(self, other: LinkedPose) -> LinkedPose:
        """The mean with another estimate of the same transform, weighed by the noise of both as if independent."""
        share = np.linalg.solve((self.noise + other.noise).T, self.noise.T).T
        off = share @ cov.pose_error(other.matrix, self.matrix)
        T = se3.transform(se3.exp_so3(off[3:]) @ self.matrix[:3, :3], self.matrix[:3, 3] + off[:3])
        noise = self.noise - share @ self.noise
        response = self.response + share @ (other.response - self.response)
        return LinkedPose(T, 0.5 * (noise + noise.T), response)

    def stated(self, calibration_covariance: FloatArray) -> UncertainTransform:
        """The pose with its whole covariance."""
        common, calibration = self.response[:, :COMMON], self.response[:, COMMON:]
        shared = common @ common.T + calibration @ calibration_covariance @ calibration.T
        return UncertainTransform(self.matrix, self.noise + 0.5 * (shared + shared.T))
