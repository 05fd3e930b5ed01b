# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN DemRegistration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import ElevationMap


@dataclass(frozen=True, slots=True, eq=False)
class DemRegistrationInputs:
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in the frame of the map by the pose as it is, metres, finite.
    noise_variance : ndarray of float64, shape (n)
        Variance of each height by the sensor's noise, square metres.
    map : ElevationMap
        What was measured before; layers mean and count.
    centre : ndarray of float64, shape (3)
        Where the sensor was; the correction turns about it, metres.
    covariance : ndarray of float64, shape (6,6)
        Of the pose at the centre: x y z rx ry rz, errors in the frame of the map.
    """

    points: NDArray[np.float64]
    noise_variance: NDArray[np.float64]
    map: ElevationMap
    centre: NDArray[np.float64]
    covariance: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class DemRegistrationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    correction : ndarray of float64, shape (4,4)
        Transform to apply to the points in the frame of the map; the identity where the map says nothing.
    covariance : ndarray of float64, shape (6,6)
        Of the corrected pose relative to the map, as the input's; the input's where nothing was corrected.
    matched : ndarray of int64, shape ()
        Points that the fit used; 0 where nothing was corrected.
    """

    correction: NDArray[np.float64]
    covariance: NDArray[np.float64]
    matched: NDArray[np.int64]


class DemRegistrationInterface(Dfn[Any, DemRegistrationInputs, DemRegistrationOutputs]):
    """Fits the points of one capture to an elevation map, within the uncertainty of the pose that brought them
    there.
    """
