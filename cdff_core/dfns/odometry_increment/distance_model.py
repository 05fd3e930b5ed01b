# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""DistanceModel: the increment's covariance grows with the distance, as wheels that slip are modelled."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.odometry_increment._interface import (
    OdometryIncrementInputs,
    OdometryIncrementInterface,
    OdometryIncrementOutputs,
)

Sigma = Annotated[float, Field(ge=0, le=10)]


class DistanceModelConfig(DfnConfig):
    """Parameters of DistanceModel.

    Slip is a scale error that wanders over metres; as a random walk it is ``slip sqrt(correlation length)`` per square
    root of a metre: 0.25 stands for 10 % over 6 m.
    """

    along_m_sqrt_m: Annotated[Sigma, Field(description="m/sqrt(m)")] = 0.25
    across_m_sqrt_m: Annotated[Sigma, Field(description="m/sqrt(m)")] = 0.08
    up_m_sqrt_m: Annotated[Sigma, Field(description="m/sqrt(m)")] = 0.08
    tilt_rad_sqrt_m: Annotated[Sigma, Field(description="rad/sqrt(m)")] = 0.05
    yaw_rad_sqrt_m: Annotated[Sigma, Field(description="rad/sqrt(m)")] = 0.02
    yaw_share: Annotated[float, Field(ge=0, le=1)] = 0.05


class DistanceModel(OdometryIncrementInterface):
    """For wheels: the covariances the driver reports are not needed."""

    Config = DistanceModelConfig
    config: DistanceModelConfig

    def setup(self) -> None:
        """Variances per metre."""
        c = self.config
        self._per_metre = np.square(
            [c.along_m_sqrt_m, c.across_m_sqrt_m, c.up_m_sqrt_m, c.tilt_rad_sqrt_m, c.tilt_rad_sqrt_m, c.yaw_rad_sqrt_m]
        )

    def process(self, inputs: OdometryIncrementInputs) -> OdometryIncrementOutputs:
        """Difference of two cumulative poses; raises InputError on an input that is no rigid transform."""
        first, second = UncertainTransform(inputs.first).matrix, UncertainTransform(inputs.second).matrix
        mount = UncertainTransform(inputs.mount).matrix
        step = mount @ se3.inverse(first) @ second @ se3.inverse(mount)
        distance_m = float(np.linalg.norm(step[:3, 3]))
        variance = self._per_metre * distance_m
        variance[5] += (self.config.yaw_share * float(se3.rotation_angle(step[:3, :3]))) ** 2
        return OdometryIncrementOutputs(step, np.diag(variance), np.asarray(distance_m))
