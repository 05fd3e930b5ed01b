# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Analyses of assembled heights: slope and roughness, visibility, change, contours, statistics of an area.

Every analysis takes the heights of a window and their errors. An error of the pose is common to the cells of
a map; the analyses use it where it matters (heights, volumes, changes) and not where it cancels (slopes,
lines of sight).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cdff_common.contract.queries import (
    TERRAIN_ANALYSES,
    AreaStatisticsParameters,
    ContourParameters,
    DifferenceParameters,
    SurfaceParameters,
    TerrainParameters,
    TerrainRasterParameters,
    ViewshedParameters,
)
from cdff_common.errors import InputError, ProductNotFoundError, UnavailableError
from cdff_common.geometry.region import Region
from cdff_common.json_form import jsonable
from cdff_common.raster.geometry import GridGeometry
from dpm_store import Store
from dpm_store.engine.time_limit import check_time
from dpm_store.maps.windows import Window, WindowQuery
from services.dpm.operations.retrieval import DeliveredProduct, Retrieval
from services.dpm.queries.store_queries import window_query
from services.dpm.rendering.convert import Converted

Float = NDArray[np.float64]

#: Longest line of sight of a viewshed without a region or range, metres.
_RANGE_M = 50.0
#: Memory of an analysis for each cell, bytes.
_CELL_BYTES = 160
#: Cells that differ by more than this multiple of their error have changed.
_CHANGED_SIGMA = 3.0
_MEDIA_TYPES = {
    "tif": "image/tiff; application=geotiff; profile=cloud-optimized",
    "npz": "application/x-npz",
    "geojson": "application/geo+json",
    "json": "application/json",
}


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Heights of a window with a margin; arrays ``(rows, cols)``, NaN where unknown.

    Attributes
    ----------
    mean, noise, shared : Float
        Heights, and their error variance without, and of, the part that the cells of a map share.
    inside : NDArray[np.bool_]
        Cells of the region.
    target : GridGeometry
        The window without the margin.
    """

    window: Window
    mean: Float
    noise: Float
    shared: Float
    inside: NDArray[np.bool_]
    target: GridGeometry

    @property
    def geometry(self) -> GridGeometry:
        """Grid with the margin."""
        return cast(GridGeometry, self.window.map.geometry)

    @property
    def coverage(self) -> float:
        """Fraction of the region that is observed."""
        cells = np.count_nonzero(self.inside)
        return float(np.count_nonzero(self.inside & np.isfinite(self.mean))) / cells if cells else 0.0

    def cut(self, values: Float) -> NDArray[np.float32]:
        """Return values of the region, without the margin, NaN outside."""
        part = self.geometry.slices_of(self.target)
        return np.where(self.inside[part], values[part], np.nan).astype(np.float32)

    def metadata(self, analysis: str) -> dict[str, Any]:
        """Return the origin of the heights."""
        return {
            **self.window.manifest(),
            "analysis": analysis,
            "frame": self.geometry.frame,
            "coverage": self.coverage,
        }


class Terrain:
    """The analyses of ``TERRAIN_ANALYSES`` over a store."""

    def __init__(self, store: Store, retrieval: Retrieval) -> None:
        self._store = store
        self._retrieval = retrieval

    def run(self, analysis: str, parameters: Mapping[str, Any]) -> DeliveredProduct:
        """Return the result of an analysis by name; raises InputError for an unknown one."""
        model = TERRAIN_ANALYSES.get(analysis)
        if model is None:
            raise InputError(
                f"analysis={analysis[:40]!r}: expected one of {', '.join(sorted(TERRAIN_ANALYSES))}"
            )
        function: Callable[[Any], DeliveredProduct] = getattr(self, analysis)
        return function(model.parse(parameters))

    def surface(self, parameters: SurfaceParameters) -> DeliveredProduct:
        """Return slope with its error, aspect and roughness, by local planes."""
        from cdff_common.raster.surface import local_surface, side_cells

        heights = self._heights(
            parameters, margin=lambda cell_m: side_cells(parameters.baseline_m, cell_m) // 2
        )
        side = side_cells(parameters.baseline_m, heights.geometry.resolution_m)
        surface = local_surface(heights.mean, heights.noise, heights.geometry.resolution_m, side)
        bands = {
            "slope_deg": np.degrees(surface.slope_rad),
            "slope_sigma_deg": np.degrees(surface.sigma_slope_rad),
            "aspect_deg": np.degrees(surface.aspect_rad),
            "roughness_m": surface.roughness_m,
        }
        surface_metadata = {"baseline_m": side * heights.geometry.resolution_m}
        return self._raster(parameters, heights, bands, heights.metadata("surface") | surface_metadata)

    def viewshed(self, parameters: ViewshedParameters) -> DeliveredProduct:
        """Return the visibility from a point: its probability, and the height that is hidden."""
        from cdff_common.raster.viewshed import viewshed

        x, y = parameters.observer
        if parameters.region is None:
            parameters = parameters.model_copy(
                update={"region": Region("circle", (x, y, parameters.range_m or _RANGE_M))}
            )
        heights = self._heights(parameters, include_m=parameters.observer)
        v = viewshed(
            heights.geometry,
            heights.mean,
            heights.noise,
            parameters.observer,
            observer_height_m=parameters.observer_height_m,
            target_height_m=parameters.target_height_m,
            range_m=parameters.range_m,
            check=lambda completed, total: check_time(completed, total, "rows of the viewshed"),
        )
        bands = {
            "visible": v.visible,
            "hidden_m": v.hidden_m,
            "hidden_sigma_m": v.sigma_m,
            "unobserved": v.unobserved,
        }
        return self._raster(parameters, heights, bands, heights.metadata("viewshed"))

    def difference(self, parameters: DifferenceParameters) -> DeliveredProduct:
        """Return the change of the heights from the captures until a time to those after it."""
        from cdff_common import raster

        query = self._query(parameters)
        if parameters.t1 is not None and parameters.t1 <= parameters.since:
            raise InputError(f"since={parameters.since}: expected earlier than t1={parameters.t1}")
        queries = [
            replace(query, t1_ns=parameters.since, newest_after_ns=None),
            replace(query, t0_ns=parameters.since + 1),
        ]
        cells = [self._store.maps.plan(q).geometry.resolution_m for q in queries]
        coarsest = max(cells)
        earlier, later = (self._window(replace(q, resolution_m=coarsest)) for q in queries)
        earlier_geometry, later_geometry = earlier.map.geometry, later.map.geometry
        if not earlier_geometry.shares_cells_with(later_geometry):
            raise InputError(
                f"cells of {cells[0]:g} m before and {cells[1]:g} m after {parameters.since}: ask for a "
                "resolution_m that is a multiple of both"
            )
        common = earlier_geometry.intersection(later_geometry)
        if common is None:
            raise ProductNotFoundError("the captures before and after that time have no common ground")
        height_before, noise_before, shared_before = _layers(earlier, common)
        height_after, noise_after, shared_after = _layers(later, common)
        change = height_after - height_before
        sigma = np.sqrt(noise_before + shared_before + noise_after + shared_after)
        known = np.isfinite(change)
        if query.region is None:
            coverage = float(np.count_nonzero(known)) / math.prod(
                earlier_geometry.union(later_geometry).shape
            )
        else:
            coverage = raster.coverage(query.region, common, known)
        _check_coverage(coverage, parameters.min_coverage)
        with np.errstate(invalid="ignore", divide="ignore"):
            bands = {"difference_m": change, "sigma_m": sigma, "significance": np.abs(change) / sigma}
        metadata = later.manifest() | {
            "analysis": "difference",
            "frame": common.frame,
            "coverage": coverage,
            "earlier": earlier.manifest(),
            **_changes(change, sigma, common.resolution_m),
        }
        rasters = {name: values.astype(np.float32) for name, values in bands.items()}
        return self._delivered(parameters.format, rasters, common, metadata)

    def contours(self, parameters: ContourParameters) -> DeliveredProduct:
        """Return contour lines as GeoJSON, each with its height and the mean error along it."""
        from cdff_common.formats.geojson import feature, write_geojson
        from cdff_common.raster.contours import contours

        heights = self._heights(parameters)
        geometry = heights.geometry
        mean = np.where(heights.inside, heights.mean, np.nan)
        sigma = np.sqrt(heights.noise + heights.shared)
        features = []
        for contour in contours(geometry, mean, parameters.interval_m):
            corners = np.concatenate(contour.lines_m)
            rows, cols, _ = geometry.cells_of(corners[:, 0], corners[:, 1])
            along = sigma[rows, cols]
            known = along[np.isfinite(along)]
            properties = {
                "height_m": contour.height_m,
                "sigma_m": float(known.mean()) if known.size else None,
                "is_index": round(contour.height_m / parameters.interval_m) % 5 == 0,
            }
            features.append(feature("MultiLineString", [], properties))
            features[-1]["geometry"]["coordinates"] = [line.tolist() for line in contour.lines_m]
        place = self._retrieval.georeference(geometry.frame, "geojson")
        data = write_geojson(features, geometry.frame, place)
        body = Converted(data, _MEDIA_TYPES["geojson"], "geojson")
        return DeliveredProduct(body, heights.metadata("contours") | {"lines": len(features)})

    def statistics(self, parameters: AreaStatisticsParameters) -> DeliveredProduct:
        """Return the statistics of the heights and slopes of a region, with the errors of mean and volume."""
        from cdff_common.raster.area_statistics import distribution, height_statistics
        from cdff_common.raster.surface import local_surface

        heights = self._heights(parameters, margin=lambda _: 1)
        known = heights.inside & np.isfinite(heights.mean)
        cell_m = heights.geometry.resolution_m
        result = height_statistics(
            heights.mean[known], heights.noise[known], heights.shared[known], cell_m, parameters.datum_m
        )
        s = local_surface(heights.mean, heights.noise, cell_m)
        slopes, roughness = np.degrees(s.slope_rad[known]), s.roughness_m[known]
        result |= {
            "slope_deg": distribution(slopes[np.isfinite(slopes)]),
            "roughness_m": distribution(roughness[np.isfinite(roughness)]),
        }
        metadata = heights.metadata("statistics")
        origin = ("frame", "coverage", "resolution_m", "patches", "robots", "oldest_ns", "newest_ns")
        document = jsonable(result | {name: metadata[name] for name in origin})
        body = Converted(json.dumps(document).encode(), _MEDIA_TYPES["json"], "json")
        return DeliveredProduct(body, metadata)

    def _query(self, parameters: TerrainParameters) -> WindowQuery:
        """Return the query of the heights, with its region at a fixed place."""
        query = window_query(parameters, self._store.clock.now_ns())
        if query.region is None:
            return query
        region = self._store.maps.patches.resolved_region(query.search(query.region))
        return replace(query, region=region)

    def _window(self, query: WindowQuery) -> Window:
        return self._retrieval.assembled(query, more_cell_bytes=_CELL_BYTES)

    def _heights(
        self,
        parameters: TerrainParameters,
        margin: Callable[[float], int] = lambda _: 0,
        include_m: tuple[float, float] | None = None,
    ) -> Heights:
        """Return the heights of a region and of a margin around it, if the margin has cells of that size.

        ``margin`` returns the number of cells for a cell size; ``include_m`` is a point in the grid.
        """
        from cdff_common import raster

        query = self._query(parameters)
        plan = self._store.maps.plan(query)
        target, cell_m = plan.geometry, plan.geometry.resolution_m
        region, wide = query.region, query
        if region is not None:
            edge_m, (x0, y0, x1, y1) = margin(cell_m) * cell_m, target.bounds
            if include_m is not None:
                x, y = include_m
                x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
            bounds = (x0 - edge_m, y0 - edge_m, x1 + edge_m, y1 + edge_m)
            wide = replace(query, region=Region("bbox", bounds), resolution_m=cell_m)
            if self._store.maps.plan(wide).geometry.resolution_m != cell_m:
                wide = query  # the surroundings are coarser
        window = self._window(wide)
        geometry = window.map.geometry
        inside = np.ones(geometry.shape, dtype=np.bool_) if region is None else raster.mask(region, geometry)
        heights = Heights(window, *_layers(window, geometry), inside, target)
        _check_coverage(heights.coverage, parameters.min_coverage)
        return heights

    def _raster(
        self,
        parameters: TerrainRasterParameters,
        heights: Heights,
        bands: Mapping[str, Float],
        metadata: dict[str, Any],
    ) -> DeliveredProduct:
        cut = {name: heights.cut(values) for name, values in bands.items()}
        return self._delivered(parameters.format, cut, heights.target, metadata)

    def _delivered(
        self,
        form: str,
        bands: Mapping[str, NDArray[np.float32]],
        geometry: GridGeometry,
        metadata: dict[str, Any],
    ) -> DeliveredProduct:
        if form == "npz":
            from cdff_common.formats.npz import write_npz

            corner = np.array([geometry.xmin_m, geometry.ymax_m])
            arrays = {**bands, "corner_m": corner, "resolution_m": np.array(geometry.resolution_m)}
            return DeliveredProduct(Converted(write_npz(arrays), _MEDIA_TYPES[form], form), metadata)
        from cdff_common.formats.geotiff import write_bands

        place = self._retrieval.georeference(geometry.frame, "tif")
        data = write_bands(bands, geometry, place=place)
        return DeliveredProduct(Converted(data, _MEDIA_TYPES[form], form), metadata)


def _layers(window: Window, geometry: GridGeometry) -> tuple[Float, Float, Float]:
    """Return the heights, the variances of their independent errors, and those of the shared errors."""
    part = window.map.geometry.slices_of(geometry)
    mean = window.map.layer("mean")[part].astype(np.float64)
    names = window.map.layer_names
    if "error_variance" not in names or "pose_variance" not in names:
        unknown = np.full(mean.shape, np.nan)
        return mean, unknown, unknown
    total, shared = (
        window.map.layer(name)[part].astype(np.float64) for name in ("error_variance", "pose_variance")
    )
    return mean, np.maximum(total - shared, 0.0), shared


def _changes(change_m: Float, sigma_m: Float, cell_m: float) -> dict[str, float | None]:
    """Return area and volumes of the changes ``(rows, cols)`` with a known error; None without any.

    NaN is an unobserved cell in ``change_m``, an unknown error in ``sigma_m``.
    """
    cell_m2 = cell_m**2
    is_known = np.isfinite(change_m) & np.isfinite(sigma_m)
    unknown_error = np.isfinite(change_m) & ~np.isfinite(sigma_m)
    result: dict[str, float | None] = dict.fromkeys(("changed_m2", "raised_m3", "lowered_m3"))
    if is_known.any():
        change = change_m[is_known]
        changed = change[np.abs(change) > _CHANGED_SIGMA * sigma_m[is_known]]
        result = {
            "changed_m2": changed.size * cell_m2,
            "raised_m3": float(changed[changed > 0].sum()) * cell_m2,
            "lowered_m3": float(-changed[changed < 0].sum()) * cell_m2,
        }
    return result | {"unknown_error_m2": float(np.count_nonzero(unknown_error)) * cell_m2}


def _check_coverage(coverage: float, required: float) -> None:
    if coverage < required:
        raise UnavailableError(f"coverage {coverage:.3f} of the region, asked {required:.3f}")
