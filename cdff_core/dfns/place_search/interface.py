# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PlaceSearch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlaceSearchInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    map_points : ndarray of float64, shape (n,3)
        Points of the map, z up, metres.
    sweep_points : ndarray of float64, shape (m,3)
        Points around the robot in its frame, z approximately up, metres.
    """

    ARRAYS = ArrayPorts({"map_points": "float64[n,3]", "sweep_points": "float64[m,3]"})

    map_points: NDArray[np.float64]
    sweep_points: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlaceSearchOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transforms : ndarray of float64, shape (k,4,4)
        T_map_robot of the candidates, best first.
    residuals_m : ndarray of float64, shape (k)
        Mean height difference between scan and map of each candidate, limited by cutoff_m, metres.
    searched : int
        Number of compared pairs of position and heading.
    """

    transforms: NDArray[np.float64]
    residuals_m: NDArray[np.float64]
    searched: int


class PlaceSearchInterface(Dfn[ConfigT, PlaceSearchInputs, PlaceSearchOutputs]):
    """Find the poses on a terrain map at which a scan could have been recorded, by comparing the shape
    of the terrain. The results are candidates for a registration, best first.
    """


#: Short names for the implementations.
Inputs = PlaceSearchInputs
Outputs = PlaceSearchOutputs
Interface = PlaceSearchInterface
