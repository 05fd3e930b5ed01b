# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN GravityLevelling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class GravityLevellingInputs:
    """Inputs of one call.

    Attributes
    ----------
    specific_force : ndarray of float64, shape (n,3)
        Accelerometer readings in the body's axes, m/s^2; upwards at rest.
    rates_rad_s : ndarray of float64, shape (n,3)
        Gyro readings of the same times in the body's axes, rad/s.
    """

    specific_force: NDArray[np.float64]
    rates_rad_s: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class GravityLevellingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    rotation : ndarray of float64, shape (3,3)
        R_level_body, level z against gravity.
    covariance : ndarray of float64, shape (3,3)
        Of the rotation, rad^2, in the level frame; heading 0 since it is defined here.
    gyro_bias_rad_s : ndarray of float64, shape (3)
        Mean rate where the body rests, else zero, rad/s.
    at_rest : ndarray of bool, shape ()
        Whether the readings are those of a body at rest.
    """

    rotation: NDArray[np.float64]
    covariance: NDArray[np.float64]
    gyro_bias_rad_s: NDArray[np.float64]
    at_rest: NDArray[np.bool_]


class GravityLevellingInterface(Dfn[Any, GravityLevellingInputs, GravityLevellingOutputs]):
    """Roll and pitch of a body from the specific force it feels, and the bias of its gyro where it rests. Heading is
    left alone: the level frame's x axis lies below the body's.
    """
