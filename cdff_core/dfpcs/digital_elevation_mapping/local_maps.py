# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Local map: alignment of captures with it, rasterisation of patches, fusion into it and the far map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.raster import delivered_resolution
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_fusion.interface import DemFusionInputs, DemFusionOutputs
from cdff_core.dfns.dem_rasterisation.interface import DemRasterisationInputs
from cdff_core.dfns.dem_registration.interface import DemRegistrationInputs
from cdff_core.dfpcs.digital_elevation_mapping.configuration import DigitalElevationMappingConfig
from cdff_core.dfpcs.digital_elevation_mapping.patch import CapturePoints, MapPoints, PendingCaptures
from cdff_core.dfpcs.digital_elevation_mapping.structure_filter import StructureFilter
from cdff_core.elevation.map_cells import MapCells


class LocalMapAligner:
    """Aligns captures with the local map by a DemRegistration.

    The error of an aligned capture is that of the map. Its height variance has three parts: the variance of
    the first pose in this frame (the anchor), which due to the tilt grows with the distance from the anchor;
    the variance of the alignment; and the variance that earlier alignments have added to the cells.
    """

    def __init__(self, registration: Dfn[Any, Any, Any]) -> None:
        self._registration = registration
        #: Frame of the map, position (3,) and covariance (6, 6) of the first pose in it.
        self._anchor: tuple[str, NDArray[np.float64], NDArray[np.float64]] | None = None

    def align(self, capture: CapturePoints, local_map: ElevationMap | None) -> CapturePoints:
        """Return the capture aligned with the map, with the remaining variance of its pose.

        The capture is unchanged without a map in its frame, without a covariance of its pose, or without
        overlap. The variance never grows.
        """
        pose = capture.pose
        if pose is None or pose.covariance is None or not len(capture.points_m):
            return capture
        centre = pose.matrix[:3, 3]
        if self._anchor is None or self._anchor[0] != capture.frame:
            self._anchor = (capture.frame, centre, pose.covariance)
        if local_map is None or local_map.frame != capture.frame:
            return capture
        alignment = self._registration.process(
            DemRegistrationInputs(
                points=capture.points_m,
                noise_variance=capture.noise_variance_m2,
                map=local_map,
                centre=centre,
                covariance=pose.covariance,
            )
        )
        if not alignment.matched:
            return capture
        points = se3.transform_points(alignment.correction, capture.points_m)
        variance = self._anchor_variance(points) + _height_variance(points - centre, alignment.covariance)
        variance += self._map_variance(points, local_map)
        origin = (
            None
            if capture.origin_m is None
            else se3.transform_points(alignment.correction, capture.origin_m[None])[0]
        )
        return replace(
            capture,
            points_m=points,
            pose_variance_m2=np.fmin(capture.pose_variance_m2, variance),
            origin_m=origin,
            correction_m=float(
                np.linalg.norm(alignment.correction[:3, :3] @ centre + alignment.correction[:3, 3] - centre)
            ),
        )

    def _anchor_variance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the height variance of points ``(n, 3)`` due to the covariance of the anchor."""
        _, centre, covariance = self._anchor or ("", np.zeros(3), np.zeros((6, 6)))
        return _height_variance(points - centre, covariance)

    def _map_variance(self, points: NDArray[np.float64], local_map: ElevationMap) -> float:
        """Return by how much the mean variance of the cells exceeds the variance of the anchor, square
        metres.
        """
        row, col, inside = local_map.geometry.cells_of(points[:, 0], points[:, 1])
        cell_variance = local_map.layer("pose_variance")[row[inside], col[inside]]
        excess = cell_variance - self._anchor_variance(points[inside])
        return max(float(np.nanmean(excess)), 0.0) if np.isfinite(excess).any() else 0.0


class LocalMaps:
    """Local map around the robot, and a far map of larger cells (four DFN slots)."""

    def __init__(self, config: DigitalElevationMappingConfig, dfn: Callable[..., Dfn[Any, Any, Any]]) -> None:
        self._config = config
        self._rasterisation = dfn("rasterisation", overhang_gap_m=config.overhang_gap_m)
        self._structure = StructureFilter(config, dfn)
        self._fusion, self._far_fusion = dfn("fusion"), dfn("far_fusion")
        #: Local map, far map and last patch; None before the first patch.
        self.local: ElevationMap | None = None
        self.far: ElevationMap | None = None
        self.patch: ElevationMap | None = None

    def add(
        self, patch: PendingCaptures, points: MapPoints, frame: str, position: NDArray[np.float64] | None
    ) -> tuple[ElevationMap, DemFusionOutputs]:
        """Rasterise a patch and fuse it into the maps around a position (2,); raises InputError."""
        raster = self._rasterise(points.select(points.near), frame, 1)
        rays = patch.rays(self._config.max_rays) if self._config.max_rays else None
        fused: DemFusionOutputs = self._fusion.process(
            DemFusionInputs(patch=raster, centre=position, rays=rays)
        )
        if self._config.far_factor:
            far_patch = self._rasterise(points, frame, self._config.far_factor)
            inputs = DemFusionInputs(patch=far_patch, centre=position, rays=rays)
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
        complete_map: ElevationMap = self._fusion.process(DemFusionInputs(bounds=np.full(4, np.nan))).map
        return complete_map

    def _rasterise(self, points: MapPoints, frame: str, factor: int) -> ElevationMap:
        """Return the elevation map of points in cells ``factor`` times the map's."""
        edge_m = self._config.resolution_m * factor
        raster: ElevationMap = self._rasterisation.process(
            DemRasterisationInputs(
                frame=frame,
                resolution_m=edge_m,
                points=points.points_m,
                height_variance=points.pose_variance_m2,
                stamps_ns=points.stamps_ns,
                noise_variance=points.noise_variance_m2,
                intensity=points.intensity,
                is_structure=self._structure.find(points.points_m, edge_m),
            )
        ).map
        return raster


def _height_variance(arm: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the variance of the heights of points at lever arms ``(n, 3)`` due to a pose's covariance."""
    J = np.column_stack([np.ones(len(arm)), arm[:, 1], -arm[:, 0]])
    return np.asarray(np.einsum("ni,ij,nj->n", J, covariance[2:5, 2:5], J))
