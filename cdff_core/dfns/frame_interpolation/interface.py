# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FrameInterpolation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameInterpolationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    first : ndarray of float64, shape (4,4)
        T_a_b at the start.
    second : ndarray of float64, shape (4,4)
        T_a_b at the end.
    interval_ns : ndarray of int64, shape (2)
        Start and end, nanoseconds.
    time_ns : int
        Time within the interval, nanoseconds.
    first_covariance : ndarray of float64, shape (6,6), optional
        Covariance of first, [x y z rx ry rz], error in frame a.
    second_covariance : ndarray of float64, shape (6,6), optional
        Covariance of second, [x y z rx ry rz], error in frame a.
    cross_covariance : ndarray of float64, shape (6,6), optional
        Cross-covariance of the errors of second (rows) and first (columns); without it, a covariance that
        is an upper bound for any correlation is returned.
    """

    ARRAYS = ArrayPorts(
        {
            "first": "float64[4,4]",
            "second": "float64[4,4]",
            "interval_ns": "int64[2]",
            "first_covariance": "float64[6,6]",
            "second_covariance": "float64[6,6]",
            "cross_covariance": "float64[6,6]",
        },
        optional=["first_covariance", "second_covariance", "cross_covariance"],
    )

    first: NDArray[np.float64]
    second: NDArray[np.float64]
    interval_ns: NDArray[np.int64]
    time_ns: int
    first_covariance: NDArray[np.float64] | None = None
    second_covariance: NDArray[np.float64] | None = None
    cross_covariance: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameInterpolationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        T_a_b at the time.
    covariance : ndarray of float64, shape (6,6)
        Covariance of the pose; NaN if one of the input covariances is absent.
    fraction : float
        0 at the start, 1 at the end.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    fraction: float


class FrameInterpolationInterface(Dfn[ConfigT, FrameInterpolationInputs, FrameInterpolationOutputs]):
    """Interpolate the pose of a moving frame between two times, with its covariance."""


#: Short names for the implementations.
Inputs = FrameInterpolationInputs
Outputs = FrameInterpolationOutputs
Interface = FrameInterpolationInterface
