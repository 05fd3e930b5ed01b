# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN KalmanCorrection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class KalmanCorrectionInputs:
    """Inputs of one call.

    Attributes
    ----------
    residual : ndarray of float64, shape (m)
        Measured less expected.
    jacobian : ndarray of float64, shape (m,n)
        Of what is measured by the state's errors.
    noise : ndarray of float64, shape (m,m)
        Covariance of the measurement.
    covariance : ndarray of float64, shape (n,n)
        Of the state's errors.
    """

    residual: NDArray[np.float64]
    jacobian: NDArray[np.float64]
    noise: NDArray[np.float64]
    covariance: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class KalmanCorrectionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    correction : ndarray of float64, shape (n)
        To be added to the state.
    covariance : ndarray of float64, shape (n,n)
        Of the errors that remain.
    gain : ndarray of float64, shape (n,m)
        Correction by residual.
    innovation : ndarray of float64, shape ()
        Squared residual by its covariance; m expected.
    """

    correction: NDArray[np.float64]
    covariance: NDArray[np.float64]
    gain: NDArray[np.float64]
    innovation: NDArray[np.float64]


class KalmanCorrectionInterface(Dfn[Any, KalmanCorrectionInputs, KalmanCorrectionOutputs]):
    """Correct the errors of a state by a measurement that depends on them linearly, or refuse a measurement that
    contradicts the state.
    """
