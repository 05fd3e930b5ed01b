# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN GyroIntegration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GyroIntegrationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    stamps_ns : ndarray of int64, shape (n)
        Ascending times of the rates, nanoseconds.
    rates_rad_s : ndarray of float64, shape (n,3)
        Angular rates about the body's axes, rad/s.
    bias_rad_s : ndarray of float64, shape (3)
        Gyroscope bias, subtracted from every rate, rad/s.
    interval_ns : ndarray of int64, shape (2)
        Start and end, nanoseconds.
    """

    ARRAYS = ArrayPorts(
        {
            "stamps_ns": "int64[n]",
            "rates_rad_s": "float64[n,3]",
            "bias_rad_s": "float64[3]",
            "interval_ns": "int64[2]",
        }
    )

    stamps_ns: NDArray[np.int64]
    rates_rad_s: NDArray[np.float64]
    bias_rad_s: NDArray[np.float64]
    interval_ns: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GyroIntegrationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    rotation : ndarray of float64, shape (3,3)
        R_body1_body2.
    covariance : ndarray of float64, shape (3,3)
        Covariance of the rotation, rad^2, in the body's first frame; formal.
    """

    rotation: NDArray[np.float64]
    covariance: NDArray[np.float64]


class GyroIntegrationInterface(Dfn[ConfigT, GyroIntegrationInputs, GyroIntegrationOutputs]):
    """Integrate angular rates to the rotation of a body between two times, with its covariance."""


#: Short names for the implementations.
Inputs = GyroIntegrationInputs
Outputs = GyroIntegrationOutputs
Interface = GyroIntegrationInterface
