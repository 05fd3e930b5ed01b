# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN TargetStatePrediction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TargetStatePredictionInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        T_frame_body at the start; the origin of the body is its centre of mass.
    velocity : ndarray of float64, shape (3)
        Velocity of the origin in the frame, m/s.
    rate : ndarray of float64, shape (3)
        Angular rate relative to the frame, in the body's axes, rad/s.
    covariance : ndarray of float64, shape (12,12)
        Covariance of the errors x y z, rx ry rz (both in the frame), velocity (in the frame), rate (in the
        body).
    duration_s : float
        Time to propagate, seconds, at least 0.
    """

    ARRAYS = ArrayPorts(
        {
            "pose": "float64[4,4]",
            "velocity": "float64[3]",
            "rate": "float64[3]",
            "covariance": "float64[12,12]",
        },
        finite=["velocity", "rate", "duration_s"],
    )

    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    rate: NDArray[np.float64]
    covariance: NDArray[np.float64]
    duration_s: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TargetStatePredictionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        T_frame_body at the end.
    velocity : ndarray of float64, shape (3)
        Velocity at the end, m/s.
    rate : ndarray of float64, shape (3)
        Angular rate at the end, in the body's axes, rad/s.
    covariance : ndarray of float64, shape (12,12)
        Covariance at the end.
    """

    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    rate: NDArray[np.float64]
    covariance: NDArray[np.float64]


class TargetStatePredictionInterface(Dfn[ConfigT, TargetStatePredictionInputs, TargetStatePredictionOutputs]):
    """Propagate pose, velocity and angular rate of a free rigid body, and their covariance, to a later
    time: constant velocity, and rotation without torque by Euler's equations.
    """


#: Short names for the implementations.
Inputs = TargetStatePredictionInputs
Outputs = TargetStatePredictionOutputs
Interface = TargetStatePredictionInterface
