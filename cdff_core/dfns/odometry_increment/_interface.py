# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN OdometryIncrement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class OdometryIncrementInputs:
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
        Of first, x y z rx ry rz in the origin's frame; absent where unknown.
    second_covariance : ndarray of float64, shape (6,6), optional
        Of second, likewise.
    """

    first: NDArray[np.float64]
    second: NDArray[np.float64]
    mount: NDArray[np.float64]
    first_covariance: NDArray[np.float64] | None = None
    second_covariance: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class OdometryIncrementOutputs:
    """Outputs of one call.

    Attributes
    ----------
    increment : ndarray of float64, shape (4,4)
        T_body1_body2.
    covariance : ndarray of float64, shape (6,6)
        Of the increment, x y z rx ry rz in the body's first frame.
    distance_m : ndarray of float64, shape ()
        Length of the increment's translation, metres.
    """

    increment: NDArray[np.float64]
    covariance: NDArray[np.float64]
    distance_m: NDArray[np.float64]


class OdometryIncrementInterface(Dfn[Any, OdometryIncrementInputs, OdometryIncrementOutputs]):
    """How the body moved between two poses of an odometry that counts from its own origin, seen through the sensor's
    mount, with the covariance of that motion alone.
    """
