# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN DemRegistration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import ElevationMap


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DemRegistrationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in the frame of the map at the uncorrected pose, metres, finite.
    noise_variance : ndarray of float64, shape (n)
        Variance of each height due to sensor noise, square metres.
    map : ElevationMap
        Map of the previous measurements; layers mean and count.
    centre : ndarray of float64, shape (3)
        Position of the sensor, the centre of rotation of the correction, metres.
    covariance : ndarray of float64, shape (6,6)
        Covariance of the pose at the centre, [x y z rx ry rz], errors in the frame of the map.
    """

    ARRAYS = ArrayPorts(
        {
            "points": "float64[n,3]",
            "noise_variance": "float64[n]",
            "centre": "float64[3]",
            "covariance": "float64[6,6]",
        },
        finite=["covariance"],
    )

    points: NDArray[np.float64]
    noise_variance: NDArray[np.float64]
    map: ElevationMap
    centre: NDArray[np.float64]
    covariance: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DemRegistrationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    correction : ndarray of float64, shape (4,4)
        Transform to apply to the points in the frame of the map; the identity if nothing was corrected.
    covariance : ndarray of float64, shape (6,6)
        Covariance of the corrected pose relative to the map; the input covariance if nothing was corrected.
    matched : int
        Number of points used by the fit; 0 if nothing was corrected.
    """

    correction: NDArray[np.float64]
    covariance: NDArray[np.float64]
    matched: int


class DemRegistrationInterface(Dfn[ConfigT, DemRegistrationInputs, DemRegistrationOutputs]):
    """Register the points of one capture with an elevation map, within the covariance of the sensor
    pose.
    """


#: Short names for the implementations.
Inputs = DemRegistrationInputs
Outputs = DemRegistrationOutputs
Interface = DemRegistrationInterface
