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
        T_frame_body at the start.
    velocity : ndarray of float64, shape (3)
        Velocity of the centre of mass in the frame, m/s.
    rate : ndarray of float64, shape (3)
        Angular rate relative to the frame, in the body's axes, rad/s.
    centre_of_mass_m : ndarray of float64, shape (3)
        Centre of mass in the frame of the body, metres.
    inertia : ndarray of float64, shape (3,3)
        Inertia of the body up to a factor, scaled to trace 3; its five errors are coefficients of
        symmetric, traceless matrices of norm 1.
    covariance : ndarray of float64, shape (20,20)
        Covariance of the errors x y z, rx ry rz (both in the frame), velocity (in the frame), rate and
        centre of mass (both in the body), inertia.
    noise_scales : ndarray of float64, shape (2), optional
        Factors of the noise densities of acceleration and angular acceleration; 1 by default.
    duration_s : float
        Time to propagate, seconds, at least 0.
    """

    ARRAYS = ArrayPorts(
        {
            "pose": "float64[4,4]",
            "velocity": "float64[3]",
            "rate": "float64[3]",
            "centre_of_mass_m": "float64[3]",
            "inertia": "float64[3,3]",
            "covariance": "float64[20,20]",
            "noise_scales": "float64[2]",
        },
        finite=["velocity", "rate", "centre_of_mass_m", "inertia", "noise_scales", "duration_s"],
        optional=["noise_scales"],
    )

    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    rate: NDArray[np.float64]
    centre_of_mass_m: NDArray[np.float64]
    inertia: NDArray[np.float64]
    covariance: NDArray[np.float64]
    duration_s: float
    noise_scales: NDArray[np.float64] | None = None


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
    covariance : ndarray of float64, shape (20,20)
        Covariance at the end.
    transition : ndarray of float64, shape (20,20)
        Derivative of the errors at the end with respect to the errors at the start.
    """

    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    rate: NDArray[np.float64]
    covariance: NDArray[np.float64]
    transition: NDArray[np.float64]


class TargetStatePredictionInterface(Dfn[ConfigT, TargetStatePredictionInputs, TargetStatePredictionOutputs]):
    """Propagate pose, velocity and angular rate of a free rigid body, and their covariance, to a later
    time. The centre of mass moves at constant velocity, and the body rotates about it without
    torque (Euler's equations).
    """


#: Short names for the implementations.
Inputs = TargetStatePredictionInputs
Outputs = TargetStatePredictionOutputs
Interface = TargetStatePredictionInterface
