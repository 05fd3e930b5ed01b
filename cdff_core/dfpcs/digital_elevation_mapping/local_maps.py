# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rasterisation of patches, and their fusion into the local map and the far map."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn
from cdff_common.raster import delivered_resolution
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_fusion.interface import DemFusionInputs, DemFusionOutputs
from cdff_core.dfns.dem_rasterisation.interface import DemRasterisationInputs
from cdff_core.dfpcs.digital_elevation_mapping.configuration import DigitalElevationMappingConfig
from cdff_core.dfpcs.digital_elevation_mapping.patch import MapPoints, Patch
from cdff_core.elevation.map_cells import MapCells


class LocalMaps:
    """Local map around the robot, and a far map of larger cells (rasterisation, fusion, far_fusion)."""

    def __init__(self, config: DigitalElevationMappingConfig, dfn: Callable[..., Dfn[Any, Any, Any]]) -> None:
        self._config = config
        self._rasterisation = dfn("rasterisation", overhang_gap_m=config.overhang_gap_m)
        self._fusion, self._far_fusion = dfn("fusion"), dfn("far_fusion")
        #: Local map, far map and last patch; None before the first patch.
        self.local: ElevationMap | None = None
        self.far: ElevationMap | None = None
        self.patch: ElevationMap | None = None

    def add(
        self, patch: Patch, points: MapPoints, frame: str, position: NDArray[np.float64] | None
    ) -> tuple[ElevationMap, DemFusionOutputs]:
        """Rasterise a patch and fuse it into the maps around a position (2,); raises InputError."""
        raster = self._rasterise(points.select(points.near), frame, 1)
        rays = patch.rays(self._config.max_rays) if self._config.max_rays else None
        fused: DemFusionOutputs = self._fusion.process(
            DemFusionInputs(patch=raster, centre=position, rays=rays)
        )
        if self._config.far_factor:
            far = self._rasterise(points, frame, self._config.far_factor)
            inputs = DemFusionInputs(patch=far, centre=position, rays=rays)
            self.far = self._far_fusion.process(inputs).map
        self.local, self.patch = fused.map, raster
        return raster, fused

    def pooled(self, local: ElevationMap, resolution_m: float) -> ElevationMap:
        """Return the local or the far map in the largest cells, by whole factors, up to ``resolution_m``."""
        if self.far is not None and resolution_m >= self.far.geometry.resolution_m:
            local = self.far
        cell_m = delivered_resolution([local.geometry.resolution_m], resolution_m)
        return MapCells.of_map(local, cell_m).to_map(local.t0_ns, local.t1_ns)

    def whole(self) -> ElevationMap:
        """Return all cells of the fusion, in larger cells above its limit."""
        whole: ElevationMap = self._fusion.process(DemFusionInputs(bounds=np.full(4, np.nan))).map
        return whole

    def _rasterise(self, points: MapPoints, frame: str, factor: int) -> ElevationMap:
        """Return the elevation map of points in cells ``factor`` times the map's."""
        raster: ElevationMap = self._rasterisation.process(
            DemRasterisationInputs(
                frame=frame,
                resolution_m=self._config.resolution_m * factor,
                points=points.points_m,
                height_variance=points.pose_variance_m2,
                stamps_ns=points.stamps_ns,
                noise_variance=points.noise_variance_m2,
                intensity=points.intensity,
            )
        ).map
        return raster
