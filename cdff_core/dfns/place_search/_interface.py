# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PlaceSearch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class PlaceSearchInputs:
    """Inputs of one call.

    Attributes
    ----------
    map : ndarray of float64, shape (n,3)
        Points of the map, z up, metres.
    scan : ndarray of float64, shape (m,3)
        Points about the robot, z roughly up, metres.
    """

    map: NDArray[np.float64]
    scan: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PlaceSearchOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transforms : ndarray of float64, shape (k,4,4)
        T_map_robot of the candidates, best first.
    residuals_m : ndarray of float64, shape (k)
        Mean distance of the scan from the map in height, cut off, of each, metres.
    searched : ndarray of int64, shape ()
        Places and headings that were compared.
    """

    transforms: NDArray[np.float64]
    residuals_m: NDArray[np.float64]
    searched: NDArray[np.int64]


class PlaceSearchInterface(Dfn[Any, PlaceSearchInputs, PlaceSearchOutputs]):
    """Where on a map of ground a scan could have been taken, by the shape of the ground alone: candidates for a
    registration, best first.
    """
