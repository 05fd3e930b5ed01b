# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN RouteSearch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import NavigationMap


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RouteSearchInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    map : NavigationMap
        Layers class and cost.
    start : ndarray of float64, shape (2)
        Start, x and y in the map's frame, metres.
    goal : ndarray of float64, shape (2), optional
        Goal, x and y in the map's frame, metres.
    """

    ARRAYS = ArrayPorts({"start": "float64[2]", "goal": "float64[2]"}, optional=["goal"])

    map: NavigationMap
    start: NDArray[np.float64]
    goal: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RouteSearchOutputs:
    """Outputs of one call.

    Attributes
    ----------
    costs_m : ndarray of float64, shape (rows,cols)
        Cost of reaching each cell as the equivalent path length on terrain of cost 0, metres; infinite if
        the cell cannot be reached.
    route : ndarray of float64, shape (n,2)
        Centres of the cells from start to goal, metres; empty without a goal.
    """

    costs_m: NDArray[np.float64]
    route: NDArray[np.float64]


class RouteSearchInterface(Dfn[ConfigT, RouteSearchInputs, RouteSearchOutputs]):
    """Compute the cost to reach each cell of a navigation map from a start, and the path of least cost
    to a goal. Paths do not cross unknown terrain or hazards.
    """


#: Short names for the implementations.
Inputs = RouteSearchInputs
Outputs = RouteSearchOutputs
Interface = RouteSearchInterface
