# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN Traversability."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import ElevationMap, NavigationMap


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TraversabilityInputs:
    """Inputs of one call.

    Attributes
    ----------
    dem : ElevationMap
        Elevation map with the layer mean. If it has the layer variance, safe cells must be below the limits
        by the configured number of standard deviations (sigmas). If it has the layer overhang_m, overhangs
        lower than the rover are hazards.
    """

    dem: ElevationMap


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TraversabilityOutputs:
    """Outputs of one call.

    Attributes
    ----------
    map : NavigationMap
        Layers class (0 unknown, 1 safe, 2 caution, 3 hazard), slope_deg, step_m, roughness_m, cost,
        confidence (probability that the cell is within all limits); NaN if unknown.
    """

    map: NavigationMap


class TraversabilityInterface(Dfn[ConfigT, TraversabilityInputs, TraversabilityOutputs]):
    """Classify the cells of an elevation map by traversability: slope and roughness under the
    footprint of the rover, and nearby steps. Unobserved terrain is never classified as safe.
    """


#: Short names for the implementations.
Inputs = TraversabilityInputs
Outputs = TraversabilityOutputs
Interface = TraversabilityInterface
