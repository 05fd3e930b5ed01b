# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC NavigationMapping."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import GroundAreas, NavigationMap, PoseTrajectory


class NavigationMappingInterface(Dfpc):
    """Rate the terrain around the rover by traversability, from elevation patches and the rover's
    limits.
    """

    name = "navigation_mapping"
    INPUT_PORTS = ("dem",)

    @abstractmethod
    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type ElevationMap. Elevation patches; each measurement is in one patch
        only.
        """

    @abstractmethod
    def get_map(self) -> NavigationMap:
        """The last navigation map."""

    @abstractmethod
    def get_polygons(self, kind: str, tolerance_m: float) -> GroundAreas:
        """Areas of a kind as polygons with holes, in the map's frame."""

    @abstractmethod
    def get_reachable(self, x_m: float, y_m: float) -> NavigationMap:
        """The map with the layer travel_cost_m: cost of reaching each cell from a point, NaN if
        unreachable.
        """

    @abstractmethod
    def get_route(self, from_x_m: float, from_y_m: float, to_x_m: float, to_y_m: float) -> PoseTrajectory:
        """The route of least cost between two points, with one pose per cell, x forward; stamps start
        at the map's time and increase by a second per metre of cost.
        """
