# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN KalmanPrediction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KalmanPredictionInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        T_world_body at the start; z of the world points up, against gravity.
    velocity : ndarray of float64, shape (3)
        Velocity of the body's origin in the world, m/s.
    biases : ndarray of float64, shape (6)
        Biases of gyroscope (rad/s) and accelerometer (m/s^2), in the body's axes.
    covariance : ndarray of float64, shape (n,n)
        Covariance of the errors x y z, rx ry rz (in the world), velocity, gyroscope bias, accelerometer
        bias, then further states, which stay constant; n is at least 15.
    interval_ns : ndarray of int64, shape (2)
        Start and end, nanoseconds.
    stamps_ns : ndarray of int64, shape (k), optional
        Ascending times of the readings, including the last reading before and the first reading after the
        interval.
    specific_force : ndarray of float64, shape (k,3), optional
        Specific force in the body's axes at the sensor, m/s^2.
    rates_rad_s : ndarray of float64, shape (k,3), optional
        Angular rates in the body's axes, rad/s.
    gravity : float, optional
        Magnitude of gravity, m/s^2; without it the forces are not used.
    lever_m : ndarray of float64, shape (3), optional
        Position of the sensor in the body, metres.
    rate_noise : float, optional
        Measured noise density of the angular rates, rad/s/sqrt(Hz); the configured noise density is the
        lower bound.
    force_noise : float, optional
        Measured noise density of the specific forces, m/s^2/sqrt(Hz); the configured noise density is the
        lower bound.
    """

    ARRAYS = ArrayPorts(
        {
            "pose": "float64[4,4]",
            "velocity": "float64[3]",
            "biases": "float64[6]",
            "covariance": "float64[n,n]",
            "interval_ns": "int64[2]",
            "stamps_ns": "int64[k]",
            "specific_force": "float64[k,3]",
            "rates_rad_s": "float64[k,3]",
            "lever_m": "float64[3]",
        },
        optional=["stamps_ns", "specific_force", "rates_rad_s", "lever_m"],
    )

    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    biases: NDArray[np.float64]
    covariance: NDArray[np.float64]
    interval_ns: NDArray[np.int64]
    stamps_ns: NDArray[np.int64] | None = None
    specific_force: NDArray[np.float64] | None = None
    rates_rad_s: NDArray[np.float64] | None = None
    gravity: float | None = None
    lever_m: NDArray[np.float64] | None = None
    rate_noise: float | None = None
    force_noise: float | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KalmanPredictionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        T_world_body at the end.
    velocity : ndarray of float64, shape (3)
        Velocity of the body's origin at the end, m/s.
    covariance : ndarray of float64, shape (n,n)
        Covariance at the end.
    transition : ndarray of float64, shape (15,15)
        Derivative of the errors at the end with respect to the errors at the start.
    inertial : bool
        True if readings covered the interval.
    """

    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    covariance: NDArray[np.float64]
    transition: NDArray[np.float64]
    inertial: bool


class KalmanPredictionInterface(Dfn[ConfigT, KalmanPredictionInputs, KalmanPredictionOutputs]):
    """Propagate a robot's pose, velocity and their covariance to a later time with inertial readings,
    or with constant velocity if there are no readings.
    """


#: Short names for the implementations.
Inputs = KalmanPredictionInputs
Outputs = KalmanPredictionOutputs
Interface = KalmanPredictionInterface
