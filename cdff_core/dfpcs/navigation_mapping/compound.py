# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where the rover may drive, from elevation patches."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.raster import delivered_resolution
from cdff_common.types import NavigationMap
from cdff_core.dfns.dem_fusion._interface import DemFusionInputs
from cdff_core.dfns.traversability._interface import TraversabilityInputs
from cdff_core.dfpcs.navigation_mapping._interface import NavigationMappingInterface

#: What the profile's rover limits are called, and the parameters of ``traversability`` they set.
LIMITS = ("length_m", "width_m", "max_slope_deg", "max_step_m", "max_roughness_m")


class NavigationMappingConfig(DfpcConfig):
    """Size and cells of the map."""

    size_m: float = Field(30.0, gt=0.0, le=1000.0, description="Edge of the square map, metres")
    resolution_m: float = Field(
        0.1, gt=0.0, le=100.0, description="Cell size, metres: the largest multiple of the patches' up to it, or theirs"
    )  # fmt: skip
    fusion: dict[str, Any] = Field(default_factory=dict)
    traversability: dict[str, Any] = Field(default_factory=dict)


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
        made: NavigationMap = self._traversability.process(TraversabilityInputs(dem=fused)).map
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

    def _fit_cells(self, patch_m: float) -> None:
        """Configure the fusion for the patches' cell size, which is known with the first patch."""
        wanted_m = delivered_resolution([patch_m], self.config.resolution_m)
        if self._fusion_m is None or wanted_m > self._fusion_m:
            self._fusion.configure({"size_m": self.config.size_m, **self.config.fusion, "resolution_m": wanted_m})
            self._fusion_m, self._inputs = wanted_m, ()

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
