# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FrameInterpolation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class FrameInterpolationInputs:
    """Inputs of one call.

    Attributes
    ----------
    first : ndarray of float64, shape (4,4)
        T_a_b at the begin.
    second : ndarray of float64, shape (4,4)
        T_a_b at the end.
    interval_ns : ndarray of int64, shape (2)
        Begin and end, nanoseconds.
    time_ns : ndarray of int64, shape ()
        Between them.
    first_covariance : ndarray of float64, shape (6,6), optional
        Of first: x y z rx ry rz, perturbation in a.
    second_covariance : ndarray of float64, shape (6,6), optional
        Of second, likewise.
    cross_covariance : ndarray of float64, shape (6,6), optional
        Of second's errors (rows) with first's; absent: the largest it can be.
    """

    first: NDArray[np.float64]
    second: NDArray[np.float64]
    interval_ns: NDArray[np.int64]
    time_ns: NDArray[np.int64]
    first_covariance: NDArray[np.float64] | None = None
    second_covariance: NDArray[np.float64] | None = None
    cross_covariance: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FrameInterpolationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        T_a_b at the time.
    covariance : ndarray of float64, shape (6,6)
        Of it; NaN where one of both is unknown.
    fraction : ndarray of float64, shape ()
        0 at the begin, 1 at the end.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    fraction: NDArray[np.float64]


class FrameInterpolationInterface(Dfn[Any, FrameInterpolationInputs, FrameInterpolationOutputs]):
    """The pose of a moving frame between two times at which it is known, with its covariance."""
