# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN BearingFiltering."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BearingFilteringInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    directions : ndarray of float64, shape (n,3)
        Unit vectors to the objects in a frame that does not rotate.
    rates : ndarray of float64, shape (n,3)
        Angular velocities of the directions, radians per second, same frame.
    covariances : ndarray of float64, shape (n,6,6)
        Covariances of rotation vector (direction) and angular velocity.
    interval : float
        Time to predict, seconds.
    measured : ndarray of float64, shape (n,3), optional
        Measured unit vectors; NaN for an object without a measurement.
    measured_covariances : ndarray of float64, shape (n,3,3), optional
        Covariances of the measured vectors, perpendicular to them.
    """

    ARRAYS = ArrayPorts(
        {
            "directions": "float64[n,3]",
            "rates": "float64[n,3]",
            "covariances": "float64[n,6,6]",
            "measured": "float64[n,3]",
            "measured_covariances": "float64[n,3,3]",
        },
        finite=["directions", "rates", "covariances"],
        optional=["measured", "measured_covariances"],
    )

    directions: NDArray[np.float64]
    rates: NDArray[np.float64]
    covariances: NDArray[np.float64]
    interval: float
    measured: NDArray[np.float64] | None = None
    measured_covariances: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BearingFilteringOutputs:
    """Outputs of one call.

    Attributes
    ----------
    directions : ndarray of float64, shape (n,3)
        Unit vectors after the interval.
    rates : ndarray of float64, shape (n,3)
        Angular velocities, radians per second.
    covariances : ndarray of float64, shape (n,6,6)
        Covariances.
    nis : ndarray of float64, shape (n)
        Normalised innovation squared, two degrees of freedom; NaN without a measurement.
    """

    directions: NDArray[np.float64]
    rates: NDArray[np.float64]
    covariances: NDArray[np.float64]
    nis: NDArray[np.float64]


class BearingFilteringInterface(Dfn[ConfigT, BearingFilteringInputs, BearingFilteringOutputs]):
    """Predict the directions and angular rates of objects, and correct them with measured directions,
    for many objects at once.
    """


#: Short names for the implementations.
Inputs = BearingFilteringInputs
Outputs = BearingFilteringOutputs
Interface = BearingFilteringInterface
