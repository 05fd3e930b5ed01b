# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN GravityLevelling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GravityLevellingInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    specific_force : ndarray of float64, shape (n,3)
        Accelerometer readings in the body's axes, m/s^2; at rest the specific force points upwards.
    rates_rad_s : ndarray of float64, shape (n,3)
        Gyroscope readings at the same times in the body's axes, rad/s.
    """

    ARRAYS = ArrayPorts(
        {"specific_force": "float64[n,3]", "rates_rad_s": "float64[n,3]"}, finite=["specific_force"]
    )

    specific_force: NDArray[np.float64]
    rates_rad_s: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GravityLevellingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    rotation : ndarray of float64, shape (3,3)
        R_level_body; z of the level frame points against gravity.
    covariance : ndarray of float64, shape (3,3)
        Covariance of the rotation, rad^2, in the level frame; heading 0 by definition.
    gyro_bias_rad_s : ndarray of float64, shape (3)
        Mean rate if the body is at rest, otherwise zero, rad/s.
    at_rest : bool
        True if the body is at rest.
    """

    rotation: NDArray[np.float64]
    covariance: NDArray[np.float64]
    gyro_bias_rad_s: NDArray[np.float64]
    at_rest: bool


class GravityLevellingInterface(Dfn[ConfigT, GravityLevellingInputs, GravityLevellingOutputs]):
    """Estimate roll and pitch of a body from its specific force, and the gyroscope bias at rest. The
    heading is arbitrary: the x axis of the level frame is the horizontal projection of the body's x
    axis.
    """


#: Short names for the implementations.
Inputs = GravityLevellingInputs
Outputs = GravityLevellingOutputs
Interface = GravityLevellingInterface
