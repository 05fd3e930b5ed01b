# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Odometry increment whose covariance grows with the distance, for wheel odometry with slip."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import compose_jacobians, rotation_blocks
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.odometry_increment.interface import Inputs, Interface, Outputs

Sigma = Annotated[float, Field(ge=0, le=10)]


class DistanceModelConfig(DfnConfig):
    """Parameters of DistanceModel.

    Slip is a scale error with a correlation length of some metres. As a random walk its standard deviation is
    ``slip sqrt(correlation length)`` per square root of a metre: 0.25 corresponds to 10 % slip over 6 m.
    """

    along_m_sqrt_m: Sigma = Field(
        0.25,
        description="Standard deviation along x of the body after one metre; variances grow linearly",
    )
    across_m_sqrt_m: Sigma = Field(0.08, description="Standard deviation along y of the body after one metre")
    up_m_sqrt_m: Sigma = Field(0.08, description="Standard deviation along z of the body after one metre")
    tilt_rad_sqrt_m: Sigma = Field(
        0.05, description="Standard deviation of roll and pitch, which are not observed, after one metre"
    )
    yaw_rad_sqrt_m: Sigma = Field(0.02, description="Standard deviation of the heading after one metre")
    yaw_fraction: float = Field(
        0.05, ge=0, le=1, description="Standard deviation of the heading as a fraction of the rotation"
    )
    pose_m: Sigma = Field(
        0.0007, description="Lower bound of the standard deviation of the position noise of a pose"
    )
    pose_rad: Sigma = Field(
        0.0002, description="Lower bound of the standard deviation of the rotation noise of a pose"
    )


class DistanceModel(Interface[DistanceModelConfig]):
    """Covariance model for wheel odometry.

    Notes
    -----
    A stated covariance that is the same for both poses does not describe the drift. It is interpreted as that
    of one increment, caused in equal parts by the noise of its two poses (jitter of the stamps, backlash,
    resolution of the encoders). A stated covariance that grows contains slip, which the model describes, and
    is not used.
    """

    def setup(self) -> None:
        """Compute the variances after one metre and those of the noise of a pose, [x y z rx ry rz]."""
        c = self.config
        self._per_metre = np.square(
            [
                c.along_m_sqrt_m,
                c.across_m_sqrt_m,
                c.up_m_sqrt_m,
                c.tilt_rad_sqrt_m,
                c.tilt_rad_sqrt_m,
                c.yaw_rad_sqrt_m,
            ]
        )
        self._pose_floor = np.square([c.pose_m] * 3 + [c.pose_rad] * 3)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the increment between two poses; raises InputError for a transform that is not rigid."""
        first, second = UncertainTransform(inputs.first).matrix, UncertainTransform(inputs.second).matrix
        mount = UncertainTransform(inputs.mount).matrix
        step = mount @ se3.inverse(first) @ second @ se3.inverse(mount)
        distance_m = float(np.linalg.norm(step[:3, 3]))
        variance = self._per_metre * distance_m
        variance[5] += (self.config.yaw_fraction * float(se3.rotation_angle(step[:3, :3]))) ** 2
        return Outputs(
            increment=step,
            covariance=np.diag(variance),
            distance_m=distance_m,
            pose_covariance=self._with_floor(_pose_noise(inputs, second, mount)),
        )

    def _with_floor(self, covariance: FloatArray) -> FloatArray:
        """Return the covariance with at least the configured variances; correlations are kept."""
        missing = np.maximum(self._pose_floor - np.diag(covariance), 0.0)
        return covariance + np.diag(missing)


def _pose_noise(inputs: Inputs, second: FloatArray, mount: FloatArray) -> FloatArray:
    """Return half of a constant stated covariance (6, 6) in the body's second frame.

    It is zero if the stated covariance changes, and for equal poses, because encoders at rest have no noise.
    """
    C1, C2 = inputs.first_covariance, inputs.second_covariance
    if np.array_equal(inputs.first, inputs.second):
        return np.zeros((6, 6))
    if C1 is None or C2 is None or not np.allclose(C1, C2, rtol=1e-6, atol=0.0):
        return np.zeros((6, 6))
    J = compose_jacobians(mount, se3.inverse(mount))[0] @ rotation_blocks(mount[:3, :3] @ second[:3, :3].T)
    return np.asarray(0.5 * J @ C2 @ J.T)
