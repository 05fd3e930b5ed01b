# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN GyroIntegration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class GyroIntegrationInputs:
    """Inputs of one call.

    Attributes
    ----------
    stamps_ns : ndarray of int64, shape (n)
        Times of the rates, rising, nanoseconds.
    rates_rad_s : ndarray of float64, shape (n,3)
        Angular rates about the body's axes, rad/s.
    bias_rad_s : ndarray of float64, shape (3)
        Taken off every rate, rad/s.
    interval_ns : ndarray of int64, shape (2)
        Begin and end, nanoseconds.
    """

    stamps_ns: NDArray[np.int64]
    rates_rad_s: NDArray[np.float64]
    bias_rad_s: NDArray[np.float64]
    interval_ns: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class GyroIntegrationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    rotation : ndarray of float64, shape (3,3)
        R_body1_body2.
    covariance : ndarray of float64, shape (3,3)
        Of the rotation, rad^2, in the body's first frame; formal.
    """

    rotation: NDArray[np.float64]
    covariance: NDArray[np.float64]


class GyroIntegrationInterface(Dfn[Any, GyroIntegrationInputs, GyroIntegrationOutputs]):
    """The rotation of a body between two times from the angular rates measured in between, with its covariance."""
