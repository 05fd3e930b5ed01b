# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CovarianceDifference: the increment's covariance is what the odometry's own covariance grew by."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.odometry_increment._interface import (
    OdometryIncrementInputs,
    OdometryIncrementInterface,
    OdometryIncrementOutputs,
)


class CovarianceDifferenceConfig(DfnConfig):
    """Parameters of CovarianceDifference."""

    floor_m: Annotated[float, Field(ge=0, le=1, description="m")] = 0.001
    floor_rad: Annotated[float, Field(ge=0, le=1, description="rad")] = 0.0003


class CovarianceDifference(OdometryIncrementInterface):
    """For an odometry that compounds its covariance from increment to increment, as visual odometry does.

    Notes
    -----
    ``S2 = J1 S1 J1^T + J2 Q J2^T`` is the compounding of ``cdff_common.geometry.covariance``; it is solved for Q. Where
    the difference is not positive (an odometry that reports one constant covariance) its negative part is cut off, and
    the floor is what remains.
    """

    Config = CovarianceDifferenceConfig
    config: CovarianceDifferenceConfig

    def process(self, inputs: OdometryIncrementInputs) -> OdometryIncrementOutputs:
        """Difference of two cumulative poses; raises InputError on an input that is no rigid transform."""
        first = UncertainTransform(inputs.first, inputs.first_covariance)
        second = UncertainTransform(inputs.second, inputs.second_covariance)
        mount = UncertainTransform(inputs.mount).matrix
        step = se3.inverse(first.matrix) @ second.matrix
        back = se3.inverse(mount)
        body = mount @ step @ back
        covariance = np.diag(np.square([self.config.floor_m] * 3 + [self.config.floor_rad] * 3))
        if first.covariance is not None and second.covariance is not None:
            grown = _growth(first, second.covariance, step)
            # Errors of the sensor's step in the body: turned by the mount, and what its turn moves at the lever.
            J = np.zeros((6, 6))
            J[:3, :3] = J[3:, 3:] = mount[:3, :3]
            J[:3, 3:] = -se3.skew(body[:3, :3] @ mount[:3, :3] @ back[:3, 3]) @ mount[:3, :3]
            covariance += J @ grown @ J.T
        return OdometryIncrementOutputs(body, covariance, np.asarray(np.linalg.norm(body[:3, 3])))


def _growth(first: UncertainTransform, second_covariance: FloatArray, step: FloatArray) -> FloatArray:
    """The positive part of Q, shape (6, 6), in the sensor's first frame."""
    R = first.matrix[:3, :3]
    J1 = np.eye(6)
    J1[:3, 3:] = -se3.skew(R @ step[:3, 3])
    J2 = np.zeros((6, 6))
    J2[:3, :3] = J2[3:, 3:] = R
    Q = J2.T @ (second_covariance - J1 @ first.covariance @ J1.T) @ J2
    values, vectors = np.linalg.eigh(0.5 * (Q + Q.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T, dtype=np.float64)
