# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Odometry increment whose covariance grows with the distance, for wheel odometry with slip."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.geometry import UncertainTransform, se3
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


class DistanceModel(Interface[DistanceModelConfig]):
    """Covariance model for wheel odometry, independent of the reported covariances."""

    def setup(self) -> None:
        """Compute the variances after one metre, [x y z rx ry rz]."""
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

    def process(self, inputs: Inputs) -> Outputs:
        """Return the increment between two poses; raises InputError for a transform that is not rigid."""
        first, second = UncertainTransform(inputs.first).matrix, UncertainTransform(inputs.second).matrix
        mount = UncertainTransform(inputs.mount).matrix
        step = mount @ se3.inverse(first) @ second @ se3.inverse(mount)
        distance_m = float(np.linalg.norm(step[:3, 3]))
        variance = self._per_metre * distance_m
        variance[5] += (self.config.yaw_fraction * float(se3.rotation_angle(step[:3, :3]))) ** 2
        return Outputs(increment=step, covariance=np.diag(variance), distance_m=distance_m)
