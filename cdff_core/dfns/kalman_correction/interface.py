# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN KalmanCorrection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KalmanCorrectionInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    residual : ndarray of float64, shape (m)
        Measured minus predicted value.
    jacobian : ndarray of float64, shape (m,n)
        Derivative of the measurement with respect to the errors of the state.
    noise : ndarray of float64, shape (m,m)
        Covariance of the measurement.
    covariance : ndarray of float64, shape (n,n)
        Covariance of the errors of the state.
    considered : ndarray of int64, shape (k), optional
        Indices of errors that contribute to the covariance but are not corrected.
    """

    ARRAYS = ArrayPorts(
        {
            "residual": "float64[m]",
            "jacobian": "float64[m,n]",
            "noise": "float64[m,m]",
            "covariance": "float64[n,n]",
            "considered": "int64[k]",
        },
        optional=["considered"],
    )

    residual: NDArray[np.float64]
    jacobian: NDArray[np.float64]
    noise: NDArray[np.float64]
    covariance: NDArray[np.float64]
    considered: NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KalmanCorrectionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    correction : ndarray of float64, shape (n)
        Correction to add to the state.
    covariance : ndarray of float64, shape (n,n)
        Covariance of the remaining errors.
    gain : ndarray of float64, shape (n,m)
        Derivative of the correction with respect to the residual.
    innovation : float
        Squared Mahalanobis norm of the residual; its expected value is m.
    """

    correction: NDArray[np.float64]
    covariance: NDArray[np.float64]
    gain: NDArray[np.float64]
    innovation: float


class KalmanCorrectionInterface(Dfn[ConfigT, KalmanCorrectionInputs, KalmanCorrectionOutputs]):
    """Correct a state by a measurement that depends linearly on its errors; a measurement that
    contradicts the state is refused.
    """


#: Short names for the implementations.
Inputs = KalmanCorrectionInputs
Outputs = KalmanCorrectionOutputs
Interface = KalmanCorrectionInterface
