# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN AttitudeFromDirections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AttitudeFromDirectionsInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    directions : ndarray of float64, shape (n,3)
        Unit vectors in the frame of the sensor.
    references : ndarray of float64, shape (n,3)
        Unit vectors in the reference frame.
    sigmas : ndarray of float64, shape (n)
        Standard deviation of each pair across the direction, radians.
    """

    ARRAYS = ArrayPorts(
        {"directions": "float64[n,3]", "references": "float64[n,3]", "sigmas": "float64[n]"},
        finite=["directions", "references"],
        positive=["sigmas"],
    )

    directions: NDArray[np.float64]
    references: NDArray[np.float64]
    sigmas: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AttitudeFromDirectionsOutputs:
    """Outputs of one call.

    Attributes
    ----------
    rotation : ndarray of float64, shape (3,3)
        R_reference_sensor.
    covariance : ndarray of float64, shape (3,3)
        Covariance of the rotation vector in the reference frame, square radians, formal.
    inliers : ndarray of bool, shape (n)
        Pairs that agree with the rotation.
    residual : float
        Root mean square of the angles between directions and references after the rotation, over the
        inliers, radians.
    """

    rotation: NDArray[np.float64]
    covariance: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    residual: float


class AttitudeFromDirectionsInterface(
    Dfn[ConfigT, AttitudeFromDirectionsInputs, AttitudeFromDirectionsOutputs]
):
    """Estimate the rotation between two frames from directions that are known in both, with
    covariance.
    """


#: Short names for the implementations.
Inputs = AttitudeFromDirectionsInputs
Outputs = AttitudeFromDirectionsOutputs
Interface = AttitudeFromDirectionsInterface
