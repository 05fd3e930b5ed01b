# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN RouteSearch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import NavigationMap


@dataclass(frozen=True, slots=True, eq=False)
class RouteSearchInputs:
    """Inputs of one call.

    Attributes
    ----------
    map : NavigationMap
        Layers class and cost.
    start : ndarray of float64, shape (2)
        X and y in the map's frame, metres.
    goal : ndarray of float64, shape (2), optional
        X and y in the map's frame, metres.
    """

    map: NavigationMap
    start: NDArray[np.float64]
    goal: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RouteSearchOutputs:
    """Outputs of one call.

    Attributes
    ----------
    costs_m : ndarray of float64, shape (rows,cols)
        Cost of reaching each cell, metres of way on ground of cost 0; infinite where it cannot be reached.
    way : ndarray of float64, shape (n,2)
        Middles of the cells from start to goal, metres; empty without a goal.
    """

    costs_m: NDArray[np.float64]
    way: NDArray[np.float64]


class RouteSearchInterface(Dfn[Any, RouteSearchInputs, RouteSearchOutputs]):
    """What it costs to reach each cell of a navigation map from a place, and the cheapest way to another; unknown
    ground and hazards are never passed.
    """
