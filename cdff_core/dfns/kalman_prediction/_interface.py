# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN KalmanPrediction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class KalmanPredictionInputs:
    """Inputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        T_world_body at the begin; world z against gravity.
    velocity : ndarray of float64, shape (3)
        Of the body's origin in the world, m/s.
    biases : ndarray of float64, shape (6)
        Of gyro (rad/s) and accelerometer (m/s^2), in the body's axes.
    covariance : ndarray of float64, shape (n,n)
        Of the errors x y z, rx ry rz (in the world), velocity, gyro bias, accelerometer bias, then any others; n of
        at least 15.
    interval_ns : ndarray of int64, shape (2)
        Begin and end, nanoseconds.
    stamps_ns : ndarray of int64, shape (k), optional
        Times of the readings, rising; those around the interval too.
    specific_force : ndarray of float64, shape (k,3), optional
        In the body's axes at the sensor, m/s^2.
    rates_rad_s : ndarray of float64, shape (k,3), optional
        In the body's axes, rad/s.
    gravity : ndarray of float64, shape (), optional
        Its strength, m/s^2; absent where unknown: the forces are then not used.
    lever_m : ndarray of float64, shape (3), optional
        Where the sensor sits in the body, metres.
    """

    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    biases: NDArray[np.float64]
    covariance: NDArray[np.float64]
    interval_ns: NDArray[np.int64]
    stamps_ns: NDArray[np.int64] | None = None
    specific_force: NDArray[np.float64] | None = None
    rates_rad_s: NDArray[np.float64] | None = None
    gravity: NDArray[np.float64] | None = None
    lever_m: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class KalmanPredictionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        T_world_body at the end.
    velocity : ndarray of float64, shape (3)
        At the end, m/s.
    covariance : ndarray of float64, shape (n,n)
        At the end.
    transition : ndarray of float64, shape (15,15)
        Errors at the end by errors at the begin.
    inertial : ndarray of bool, shape ()
        Whether readings covered the interval.
    """

    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    covariance: NDArray[np.float64]
    transition: NDArray[np.float64]
    inertial: NDArray[np.bool_]


class KalmanPredictionInterface(Dfn[Any, KalmanPredictionInputs, KalmanPredictionOutputs]):
    """Move a robot's pose, velocity and their covariance on to a later time by what its inertial sensors felt in
    between, or by its velocity alone where they felt nothing.
    """
