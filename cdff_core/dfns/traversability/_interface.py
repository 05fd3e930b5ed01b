# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN Traversability."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import ElevationMap, NavigationMap


@dataclass(frozen=True, slots=True, eq=False)
class TraversabilityInputs:
    """Inputs of one call.

    Attributes
    ----------
    dem : ElevationMap
        Elevation map with the layer mean; with variance, what is called safe is so at some standard deviations;
        with overhang_m, what hangs lower than the rover is high is a hazard.
    """

    dem: ElevationMap


@dataclass(frozen=True, slots=True, eq=False)
class TraversabilityOutputs:
    """Outputs of one call.

    Attributes
    ----------
    map : NavigationMap
        Layers class (0 unknown, 1 safe, 2 caution, 3 hazard), slope_deg, step_m, roughness_m, cost, confidence
        (that the cell keeps its limits); NaN where unknown.
    """

    map: NavigationMap


class TraversabilityInterface(Dfn[Any, TraversabilityInputs, TraversabilityOutputs]):
    """Where a rover may stand on an elevation map, from slope and roughness under its footprint and steps in its
    way; unobserved ground is never free.
    """
