# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where the rover may drive, from elevation patches."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.raster import delivered_resolution
from cdff_common.raster.areas import CLASSES, outlined
from cdff_common.types import ElevationMap, GroundAreas, NavigationMap, PoseTrajectory
from cdff_common.types.ground_areas_ext import AreaKind
from cdff_core.dfns.dem_fusion._interface import DemFusionInputs
from cdff_core.dfns.route_search._interface import RouteSearchInputs
from cdff_core.dfns.traversability._interface import TraversabilityInputs
from cdff_core.dfpcs.navigation_mapping._increment import rated
from cdff_core.dfpcs.navigation_mapping._interface import NavigationMappingInterface

#: What the profile's rover limits are called, and the parameters of ``traversability`` they set.
LIMITS = ("length_m", "width_m", "height_m", "max_slope_deg", "max_step_m", "max_roughness_m")
#: What areas are asked for by.
KINDS = {
    "free": (AreaKind.SAFE,), "caution": (AreaKind.CAUTION,), "hazard": (AreaKind.HAZARD,), "all": CLASSES,
    "passable": (AreaKind.PASSABLE,), "blocked": (AreaKind.BLOCKED,),
}  # fmt: skip


class NavigationMappingConfig(DfpcConfig):
    """Size and cells of the map."""

    size_m: float = Field(30.0, gt=0.0, le=1000.0, description="Edge of the square map, metres")
    resolution_m: float = Field(
        0.1, gt=0.0, le=100.0, description="Cell size, metres: the largest multiple of the patches' up to it, or theirs"
    )  # fmt: skip
    fusion: dict[str, Any] = Field(default_factory=dict)
    traversability: dict[str, Any] = Field(default_factory=dict)
    route: dict[str, Any] = Field(default_factory=dict)


class NavigationMapping(NavigationMappingInterface):
    """Each patch is pooled into a map around it; the classes of that map are published when they changed."""

    Config: ClassVar[type[DfpcConfig]] = NavigationMappingConfig

    def setup(self) -> None:
        """Make the DFNs, with the rover's limits where the configuration does not state them."""
        self._traversability = self.dfn("traversability")
        stated = self._traversability.config.model_dump(exclude_unset=True)
        limits = {name: float(self.context.limits[name]) for name in LIMITS if name in self.context.limits}
        self._traversability.configure({**limits, **stated})
        self._fusion = self.dfn("fusion")
        self._fusion_m: float | None = None
        self._inputs: tuple[str, ...] = ()
        self._route = self.dfn("route")
        self._dem: ElevationMap | None = None
        self._map: NavigationMap | None = None
        self.store.offer("navigation_map", lambda: self._map)

    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Pool the patch, rate the ground, publish if the map changed; a patch that cannot be used is reported."""
        if sample.value is None:
            return []
        try:
            self._fit_cells(sample.value.geometry.resolution_m)
            fused = self._fusion.process(DemFusionInputs(patch=sample.value)).map
        except InputError as error:
            quality = Quality(status=Status.FAILED, reasons=(f"patch_refused:{error}",))
            t0_ns, t1_ns = sample.value.t0_ns, sample.value.t1_ns
            return [Output("navigation_map", None, t0_ns, t1_ns, sample.value.frame, quality=quality)]
        before = None if self._dem is None or self._map is None else (self._dem, self._map)
        made = rated(fused, before, self._reach_m(fused.geometry.resolution_m), self._rated)
        self._dem = fused
        self._inputs = (*self._inputs, sample.id)[-_MAX_INPUTS:] if sample.id else self._inputs
        previous, self._map = self._map, made
        if previous is not None and _same(previous, made):
            return []
        quality = self._quality(made, sample)
        return [
            Output("navigation_map", made, made.t0_ns, made.t1_ns, made.frame, quality=quality, inputs=self._inputs)
        ]

    def get_map(self) -> NavigationMap:
        """The map as last computed; raises ProductNotFoundError before the first patch."""
        if self._map is None:
            raise ProductNotFoundError(f"{self.name}: no elevation patch has come yet")
        return self._map

    def get_polygons(self, kind: str, tolerance_m: float) -> GroundAreas:
        """Areas of a kind; raises InputError on an unknown kind or a tolerance below 0."""
        if kind not in KINDS:
            raise InputError(f"{self.name}.get_polygons: kind {kind!r}, expected one of {', '.join(KINDS)}")
        if not 0.0 <= tolerance_m < np.inf:
            raise InputError(f"{self.name}.get_polygons: tolerance_m {tolerance_m}, expected 0 or more")
        return outlined(self.get_map(), KINDS[kind], tolerance_m)

    def get_reachable(self, x_m: float, y_m: float) -> NavigationMap:
        """The map with what it costs to get to each cell; raises InputError, or RefusedError where x, y is blocked."""
        whole = self.get_map()
        costs = self._route.process(RouteSearchInputs(whole, np.array([x_m, y_m]))).costs_m
        reached = np.where(np.isfinite(costs), costs, np.nan).astype(np.float32)
        layers = {name: whole.layer(name) for name in whole.layer_names} | {"travel_cost_m": reached}
        return NavigationMap.from_layers(whole.geometry, layers, t0_ns=whole.t0_ns, t1_ns=whole.t1_ns)

    def get_route(self, from_x_m: float, from_y_m: float, to_x_m: float, to_y_m: float) -> PoseTrajectory:
        """The cheapest way; raises InputError, or RefusedError where an end is blocked or there is no way."""
        whole, dem = self.get_map(), self._dem
        ends = np.array([[from_x_m, from_y_m], [to_x_m, to_y_m]])
        found = self._route.process(RouteSearchInputs(whole, ends[0], ends[1]))
        row, col, _ = whole.geometry.cells_of(found.way[:, 0], found.way[:, 1])
        heights = dem.layer("mean")[row, col].astype(np.float64) if dem is not None else np.zeros(len(row))
        ahead = np.diff(found.way, axis=0, append=found.way[-1:])
        ahead[-1] = ahead[-2] if len(ahead) > 1 else [1.0, 0.0]
        turns = np.zeros((len(row), 3))
        turns[:, 2] = np.arctan2(ahead[:, 1], ahead[:, 0])
        poses = se3.transform(se3.exp_so3(turns), np.column_stack([found.way, heights]))
        # A metre of cost is a second: stamps are whole microseconds and rise with every cell.
        stamps_ns = whole.t1_ns + 1000 * np.rint(1e6 * found.costs_m[row, col]).astype(np.int64)
        return PoseTrajectory.from_arrays(stamps_ns, poses, parent=whole.frame, child=f"{self.context.robot}/base")

    def _rated(self, dem: ElevationMap) -> NavigationMap:
        made: NavigationMap = self._traversability.process(TraversabilityInputs(dem=dem)).map
        return made

    def _reach_m(self, cell_m: float) -> float:
        """How far a height bears on the classes of others: through planes, steps, holes and inflation."""
        c = self._traversability.config
        footprint_m = 0.5 * max(c.length_m, c.width_m)
        inflation_m = 0.5 * float(np.hypot(c.length_m, c.width_m)) + c.margin_m + c.gap_m
        return max(footprint_m, max(c.step_reach_m, 2.0 * cell_m) + inflation_m) + 4.0 * cell_m

    def _fit_cells(self, patch_m: float) -> None:
        """Configure the fusion for the patches' cell size, which is known with the first patch."""
        wanted_m = delivered_resolution([patch_m], self.config.resolution_m)
        if self._fusion_m is None or wanted_m > self._fusion_m:
            self._fusion.configure({"size_m": self.config.size_m, **self.config.fusion, "resolution_m": wanted_m})
            self._fusion_m, self._inputs, self._dem = wanted_m, (), None

    def _quality(self, made: NavigationMap, sample: Sample) -> Quality:
        counts = np.bincount(made.layer("class").ravel(), minlength=4)
        status, reasons = Status.OK, tuple[str, ...]()
        if sample.quality.status is Status.DEGRADED:
            status, reasons = Status.DEGRADED, tuple(f"dem_{reason}" for reason in sample.quality.reasons)
        return Quality(
            status=status, reasons=reasons,
            metrics={name: int(counts[i]) for i, name in enumerate(("unknown", "safe", "caution", "hazard"))},
        )  # fmt: skip


#: Most patches named as inputs: those that can still lie in the map at a patch a second.
_MAX_INPUTS = 256


def _same(first: NavigationMap, second: NavigationMap) -> bool:
    """Whether two maps have the same cells and layers; their times may differ."""
    return first.geometry == second.geometry and all(
        np.array_equal(first.layer(name), second.layer(name), equal_nan=name != "class") for name in second.layer_names
    )
