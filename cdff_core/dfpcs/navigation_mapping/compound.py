# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of NavigationMapping: fuse, rate traversability, publish; answer queries on areas and routes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.raster import delivered_resolution
from cdff_common.raster.areas import CLASSES, area_outlines
from cdff_common.types import ElevationMap, GroundAreas, NavigationMap, PoseTrajectory
from cdff_common.types.ground_areas_ext import AreaKind
from cdff_core.dfns.dem_fusion.interface import DemFusionInputs
from cdff_core.dfns.route_search.interface import RouteSearchInputs
from cdff_core.dfns.traversability.interface import TraversabilityInputs
from cdff_core.dfpcs.navigation_mapping.configuration import NavigationMappingConfig
from cdff_core.dfpcs.navigation_mapping.incremental_update import update_rating
from cdff_core.dfpcs.navigation_mapping.interface import NavigationMappingInterface

#: Rover limits of the profile; each sets the parameter of ``traversability`` of the same name.
LIMITS = ("length_m", "width_m", "height_m", "max_slope_deg", "max_step_m", "max_roughness_m")
#: Greatest number of patches listed as inputs.
_MAX_INPUTS = 256
#: Kinds of areas by their names in queries.
KINDS = {
    "free": (AreaKind.SAFE,),
    "caution": (AreaKind.CAUTION,),
    "hazard": (AreaKind.HAZARD,),
    "all": CLASSES,
    "passable": (AreaKind.PASSABLE,),
    "blocked": (AreaKind.BLOCKED,),
}


class NavigationMapping(NavigationMappingInterface):
    """Map of traversability around the newest patch, published when it changes."""

    Config = NavigationMappingConfig

    def setup(self) -> None:
        """Create the DFNs with the rover's limits, unless configured; offer the store item."""
        limits = {name: float(self.context.limits[name]) for name in LIMITS if name in self.context.limits}
        self._traversability = self.dfn("traversability", **limits)
        self._fusion = self.dfn("fusion", size_m=self.config.size_m)
        self._fusion_m: float | None = None  # cell size of the fusion; None before the first patch
        self._inputs: tuple[str, ...] = ()
        self._route = self.dfn("route")
        self._dem: ElevationMap | None = None
        self._map: NavigationMap | None = None
        self.store.offer("navigation_map", lambda: self._map)

    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Fuse the patch, rate the traversability, publish if the map changed; report an unusable patch."""
        if sample.value is None:
            return []
        try:
            self._fit_cells(sample.value.geometry.resolution_m)
            fused = self._fusion.process(DemFusionInputs(patch=sample.value)).map
        except InputError as error:
            quality = Quality.failed(f"patch_refused:{error}")
            t0_ns, t1_ns = sample.value.t0_ns, sample.value.t1_ns
            return [Output("navigation_map", None, t0_ns, t1_ns, sample.value.frame, quality=quality)]
        previous = self._map
        previous_pair = None if self._dem is None or previous is None else (self._dem, previous)
        self._dem, self._map = fused, update_rating(fused, previous_pair, self._reach_m(), self._rate)
        if sample.id:
            self._inputs = (*self._inputs, sample.id)[-_MAX_INPUTS:]
        if previous is not None and _is_equal(previous, self._map):
            return []
        rated, quality = self._map, self._quality(self._map, sample)
        return [
            Output(
                "navigation_map", rated, rated.t0_ns, rated.t1_ns, rated.frame, None, quality, self._inputs
            )
        ]

    def get_map(self) -> NavigationMap:
        """Return the last map; raises ProductNotFoundError before the first patch."""
        if self._map is None:
            raise ProductNotFoundError(f"{self.name}: no elevation patch was received yet")
        return self._map

    def get_polygons(self, kind: str, tolerance_m: float) -> GroundAreas:
        """Return the areas of a kind; raises InputError on an unknown kind or a negative tolerance."""
        if kind not in KINDS:
            raise InputError(f"{self.name}.get_polygons: kind {kind!r}, expected one of {', '.join(KINDS)}")
        if not 0.0 <= tolerance_m < np.inf:
            raise InputError(f"{self.name}.get_polygons: tolerance_m {tolerance_m}, expected 0 or more")
        return area_outlines(self.get_map(), KINDS[kind], tolerance_m)

    def get_reachable(self, x_m: float, y_m: float) -> NavigationMap:
        """Return the map with the cost of reaching each cell; raises InputError or RefusedError."""
        rated = self.get_map()
        costs_m = self._route.process(RouteSearchInputs(map=rated, start=np.array([x_m, y_m]))).costs_m
        travel_cost_m = np.where(np.isfinite(costs_m), costs_m, np.nan).astype(np.float32)
        layers = {name: rated.layer(name) for name in rated.layer_names} | {"travel_cost_m": travel_cost_m}
        return NavigationMap.from_layers(rated.geometry, layers, t0_ns=rated.t0_ns, t1_ns=rated.t1_ns)

    def get_route(self, from_x_m: float, from_y_m: float, to_x_m: float, to_y_m: float) -> PoseTrajectory:
        """Return the route of least cost; raises InputError, or RefusedError if no route exists."""
        rated, dem = self.get_map(), self._dem
        start_and_goal = np.array([[from_x_m, from_y_m], [to_x_m, to_y_m]])
        route = self._route.process(
            RouteSearchInputs(map=rated, start=start_and_goal[0], goal=start_and_goal[1])
        )
        row, col, _ = rated.geometry.cells_of(route.route[:, 0], route.route[:, 1])
        heights = dem.layer("mean")[row, col].astype(np.float64) if dem is not None else np.zeros(len(row))
        forward = np.diff(route.route, axis=0, append=route.route[-1:])
        forward[-1] = forward[-2] if len(forward) > 1 else [1.0, 0.0]
        rotations = np.zeros((len(row), 3))
        rotations[:, 2] = np.arctan2(forward[:, 1], forward[:, 0])
        poses = se3.transform(se3.exp_so3(rotations), np.column_stack([route.route, heights]))
        # A metre of cost counts as a second, so that stamps (whole microseconds) increase from cell to cell.
        stamps_ns = rated.t1_ns + 1000 * np.rint(1e6 * route.costs_m[row, col]).astype(np.int64)
        return PoseTrajectory.from_arrays(
            stamps_ns, poses, parent=rated.frame, child=f"{self.context.robot}/base"
        )

    def _rate(self, dem: ElevationMap) -> NavigationMap:
        rated: NavigationMap = self._traversability.process(TraversabilityInputs(dem=dem)).map
        return rated

    def _reach_m(self) -> float:
        """Return the distance over which a height affects ratings: by planes, steps, holes, inflation."""
        c, cell_m = self._traversability.config, self._fusion_m or self.config.resolution_m
        inflation_m = 0.5 * float(np.hypot(c.length_m, c.width_m)) + c.margin_m + c.gap_m
        reach_m: float = max(c.step_reach_m, 2.0 * cell_m) + inflation_m + 4.0 * cell_m
        return reach_m

    def _fit_cells(self, patch_m: float) -> None:
        """Configure the fusion for the cell size of the patches; larger cells start a new map."""
        resolution_m = delivered_resolution([patch_m], self.config.resolution_m)
        if self._fusion_m is None or resolution_m > self._fusion_m:
            self._fusion.configure(self._fusion.config.model_copy(update={"resolution_m": resolution_m}))
            self._fusion_m, self._inputs, self._dem = resolution_m, (), None

    def _quality(self, rated: NavigationMap, sample: Sample) -> Quality:
        counts = np.bincount(rated.layer("class").ravel(), minlength=4)
        is_degraded = sample.quality.status is Status.DEGRADED
        return Quality(
            status=Status.DEGRADED if is_degraded else Status.OK,
            reasons=tuple(f"dem_{reason}" for reason in sample.quality.reasons) if is_degraded else (),
            metrics=dict(zip(("unknown", "safe", "caution", "hazard"), counts.tolist(), strict=False)),
        )


def _is_equal(first: NavigationMap, second: NavigationMap) -> bool:
    """Return whether two maps have the same cells and layers; times may differ."""
    return first.geometry == second.geometry and all(
        np.array_equal(first.layer(name), second.layer(name), equal_nan=name != "class")
        for name in second.layer_names
    )
