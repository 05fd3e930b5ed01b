# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PoseEstimation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PoseEstimationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    prediction : ndarray of float64, shape (4,4)
        Predicted T_map_body.
    prediction_covariance : ndarray of float64, shape (6,6)
        Covariance of the prediction, [x y z rx ry rz], perturbation in the map's frame.
    measurement : ndarray of float64, shape (4,4)
        Measured T_map_body.
    measurement_covariance : ndarray of float64, shape (6,6)
        Covariance of the measurement, [x y z rx ry rz], perturbation in the map's frame.
    """

    ARRAYS = ArrayPorts(
        {
            "prediction": "float64[4,4]",
            "prediction_covariance": "float64[6,6]",
            "measurement": "float64[4,4]",
            "measurement_covariance": "float64[6,6]",
        }
    )

    prediction: NDArray[np.float64]
    prediction_covariance: NDArray[np.float64]
    measurement: NDArray[np.float64]
    measurement_covariance: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PoseEstimationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        Combined T_map_body.
    covariance : ndarray of float64, shape (6,6)
        Covariance of the pose: along each common direction the smaller of both variances, [x y z rx ry rz],
        perturbation in the map's frame.
    innovation : float
        Squared Mahalanobis distance between prediction and measurement; its expected value is 6.
    measured_directions : int
        Number of the six directions along which the measurement has the smaller variance.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    innovation: float
    measured_directions: int


class PoseEstimationInterface(Dfn[ConfigT, PoseEstimationInputs, PoseEstimationOutputs]):
    """Combine a predicted pose with a measured pose, each with its covariance, or refuse a measurement
    that contradicts the prediction.
    """


#: Short names for the implementations.
Inputs = PoseEstimationInputs
Outputs = PoseEstimationOutputs
Interface = PoseEstimationInterface
