# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN OdometryIncrement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OdometryIncrementInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    first : ndarray of float64, shape (4,4)
        T_origin_sensor at the first time.
    second : ndarray of float64, shape (4,4)
        T_origin_sensor at the second time.
    mount : ndarray of float64, shape (4,4)
        T_body_sensor.
    first_covariance : ndarray of float64, shape (6,6), optional
        Covariance of first, [x y z rx ry rz] in the frame of the origin; absent if unknown.
    second_covariance : ndarray of float64, shape (6,6), optional
        Covariance of second, [x y z rx ry rz] in the frame of the origin; absent if unknown.
    """

    ARRAYS = ArrayPorts(
        {
            "first": "float64[4,4]",
            "second": "float64[4,4]",
            "mount": "float64[4,4]",
            "first_covariance": "float64[6,6]",
            "second_covariance": "float64[6,6]",
        },
        optional=["first_covariance", "second_covariance"],
    )

    first: NDArray[np.float64]
    second: NDArray[np.float64]
    mount: NDArray[np.float64]
    first_covariance: NDArray[np.float64] | None = None
    second_covariance: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OdometryIncrementOutputs:
    """Outputs of one call.

    Attributes
    ----------
    increment : ndarray of float64, shape (4,4)
        T_body1_body2.
    covariance : ndarray of float64, shape (6,6)
        Covariance of the increment, [x y z rx ry rz] in the body's first frame.
    distance_m : float
        Length of the increment's translation, metres.
    pose_covariance : ndarray of float64, shape (6,6)
        Covariance of the noise of the second pose, [x y z rx ry rz] in the body's second frame; this noise
        also affects the next increment, but not the poses after it.
    """

    increment: NDArray[np.float64]
    covariance: NDArray[np.float64]
    distance_m: float
    pose_covariance: NDArray[np.float64]


class OdometryIncrementInterface(Dfn[ConfigT, OdometryIncrementInputs, OdometryIncrementOutputs]):
    """Compute the motion of the body between two poses of an odometry, with the covariance of this
    motion. The mount of the sensor relates the poses of the sensor to those of the body.
    """


#: Short names for the implementations.
Inputs = OdometryIncrementInputs
Outputs = OdometryIncrementOutputs
Interface = OdometryIncrementInterface
