# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Odometry increment whose covariance is the increase of the covariance reported by the odometry."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import compose_jacobians, nearest_semidefinite, rotation_blocks
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.odometry_increment.interface import Inputs, Interface, Outputs


class CovarianceDifferenceConfig(DfnConfig):
    """Parameters of CovarianceDifference."""

    floor_m: float = Field(
        0.001, ge=0, le=1, description="Lower bound of the standard deviation of a translation"
    )
    floor_rad: float = Field(
        0.0003, ge=0, le=1, description="Lower bound of the standard deviation of a rotation"
    )


class CovarianceDifference(Interface[CovarianceDifferenceConfig]):
    """Covariance model for an odometry that compounds its covariance from increment to increment, as visual
    odometry does.

    Notes
    -----
    The compounding ``S2 = J1 S1 J1^T + J2 Q J2^T`` of ``cdff_common.geometry.covariance`` is solved for Q. If
    Q is not positive semi-definite (an odometry that reports a constant covariance), its negative part is set
    to 0, so that only the lower bound remains.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the increment between two poses; raises InputError for a transform that is not rigid or an
        invalid covariance.
        """
        first = UncertainTransform(inputs.first, inputs.first_covariance)
        second = UncertainTransform(inputs.second, inputs.second_covariance)
        mount = UncertainTransform(inputs.mount).matrix
        sensor_step = se3.inverse(first.matrix) @ second.matrix
        T_sensor_body = se3.inverse(mount)
        body_step = mount @ sensor_step @ T_sensor_body
        covariance = np.diag(np.square([self.config.floor_m] * 3 + [self.config.floor_rad] * 3))
        if first.covariance is not None and second.covariance is not None:
            sensor_covariance = _increase(
                first.matrix[:3, :3], first.covariance, second.covariance, sensor_step
            )
            # Composition of the exact mount, the uncertain step and the exact inverse of the mount.
            J = compose_jacobians(mount @ sensor_step, T_sensor_body)[0] @ rotation_blocks(mount[:3, :3])
            covariance += J @ sensor_covariance @ J.T
        return Outputs(
            increment=body_step,
            covariance=covariance,
            distance_m=float(np.linalg.norm(body_step[:3, 3])),
            pose_covariance=np.zeros((6, 6)),
        )


def _increase(R: FloatArray, first: FloatArray, second: FloatArray, step: FloatArray) -> FloatArray:
    """Return the positive semi-definite part of Q (6, 6), the covariance of the step, in the first frame of
    the sensor.
    """
    J1, J2 = compose_jacobians(se3.transform(R, np.zeros(3)), step)
    return nearest_semidefinite(J2.T @ (second - J1 @ first @ J1.T) @ J2)
