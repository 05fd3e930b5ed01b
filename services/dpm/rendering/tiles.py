# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tiles of elevation and navigation: as PNG, or their values as GeoTIFF or plain float32; cached until
they change.
"""

from __future__ import annotations

import hashlib
import io
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, log2
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geodesy import FrameLocation, Georeference
from cdff_common.geodesy.body_grid import BodyTile
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.rendering import (
    ANALYSES,
    NAVIGATION,
    RELIEF_STYLE,
    RENDERINGS,
    LayerStyle,
    indices,
    relief,
)
from cdff_common.raster.tiles import FINEST_M, HALF_SIDE_M, LAST_LEVEL, TILE_CELLS, Tile, cell_m
from dpm_store import Store
from dpm_store.maps.tile_changes import Change, tiles_of_change
from services.dpm.rendering.tile_cells import (
    NEWEST,
    NO_ANALYSIS,
    MapState,
    TileAnalysis,
    TileCells,
    ViewshedCache,
)

#: Layer of the coloured relief; its values are heights.
RELIEF = "dem"
CLASSES = "navigation_map"
#: Style and product type of each tile layer.
LAYER_STYLES: dict[str, LayerStyle] = {RELIEF: RELIEF_STYLE, **RENDERINGS, **NAVIGATION}
LAYERS = {name: "navigation_map" if name in NAVIGATION else "dem" for name in LAYER_STYLES}
#: Styles and product types of these and of the analyses, which need parameters.
ALL_STYLES: dict[str, LayerStyle] = {**LAYER_STYLES, **ANALYSES}
PRODUCTS = {**LAYERS, **dict.fromkeys(ANALYSES, "dem")}
MEDIA_TYPES = {
    "png": "image/png",
    "tif": "image/tiff; application=geotiff",
    "bin": "application/octet-stream",
}
#: Memory for encoded tiles.
_CACHE_BYTES = 32 << 20
#: Largest number of tiles of a body's grid and of earlier states that are kept in memory.
_MOST_OTHERS = 128
#: Largest number of cells of a frame that one tile of a body's grid is made from.
_MOST_CELLS = 1 << 21
_LEGEND_PX = (256, 42)


@dataclass(frozen=True, slots=True)
class TileRequest:
    """A requested tile; raises InputError for an unknown layer, form or range.

    Attributes
    ----------
    tile : Tile or BodyTile
        A tile of the frame's grid, or of that of its body.
    low, high : float or None
        Range of the colours, in the layer's unit; None for the default of the layer.
    state : MapState
    analysis : TileAnalysis
        Parameters of ``ANALYSES``.
    """

    frame: str
    layer: str
    tile: Tile | BodyTile
    form: str = "png"
    low: float | None = None
    high: float | None = None
    state: MapState = NEWEST
    analysis: TileAnalysis = NO_ANALYSIS

    def __post_init__(self) -> None:
        if self.layer not in PRODUCTS:
            raise InputError(f"layer={self.layer[:40]!r}: expected one of {', '.join(PRODUCTS)}")
        self.analysis.check(self.layer)
        if self.form not in MEDIA_TYPES:
            raise InputError(f"a tile as {self.form[:16]!r}: expected one of {', '.join(MEDIA_TYPES)}")
        range_of(self.layer, self.low, self.high)

    @property
    def range(self) -> tuple[float, float]:
        """Values of the first and of the last colour."""
        return range_of(self.layer, self.low, self.high)


@dataclass(frozen=True, slots=True)
class RenderedTile:
    """Bytes of a tile and their ETag."""

    data: bytes
    media_type: str
    etag: str


class Tiles:
    """Renders and caches tiles of a store."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._cache: OrderedDict[tuple[str, int, int, int], dict[TileRequest, RenderedTile]] = OrderedDict()
        # Tiles of a body's grid and of earlier states, until any map changes
        self._others: OrderedDict[tuple[TileRequest, FrameLocation], RenderedTile] = OrderedDict()
        self._viewsheds = ViewshedCache()
        self._bytes = self._changes = 0
        store.pyramid.listen(self._drop)

    def get(self, request: TileRequest) -> RenderedTile:
        """Return one tile; transparent, or NaN, where unobserved.

        A tile with smaller cells than the maps in it shows the cells of these, enlarged.
        """
        self._store.pyramid.sync()
        if isinstance(request.tile, Tile) and request.state == NEWEST and request.layer in LAYERS:
            return self._of_frame(request, request.tile)
        location = self._store.anchors.of(request.frame)
        with self._lock:
            changes = self._changes
            cached = self._others.get((request, location))
        if cached is not None:
            return cached
        rendered = self._rendered(request, location)
        with self._lock:
            if self._changes == changes:
                self._others[request, location] = rendered
                while len(self._others) > _MOST_OTHERS:
                    self._others.popitem(last=False)
        return rendered

    def _of_frame(self, request: TileRequest, tile: Tile) -> RenderedTile:
        key = (request.frame, tile.z, tile.x, tile.y)
        with self._lock:
            changes = self._changes
            cached = self._cache.get(key, {}).get(request)
            if cached is not None:
                self._cache.move_to_end(key)
                return cached
        location = (
            self._store.anchors.of(request.frame) if request.form == "tif" else FrameLocation(request.frame)
        )
        rendered = self._rendered(request, location)
        self._add_to_cache(key, request, rendered, changes)
        return rendered

    def _rendered(self, request: TileRequest, location: FrameLocation) -> RenderedTile:
        if isinstance(request.tile, BodyTile):
            raster = self._body_raster(request, request.tile, location)
            geometry, place = request.tile.geometry, Georeference(request.tile.grid.crs.to_wkt("WKT2_2019"))
        else:
            geometry, place = request.tile.geometry(request.frame), location.georeference
            raster = self._frame_raster(request, request.tile.z, geometry)
        data = encoded_layer(request.layer, request.form, raster, geometry, place)
        etag = f'"{hashlib.blake2b(data, digest_size=12).hexdigest()}"'
        return RenderedTile(data, MEDIA_TYPES[request.form], etag)

    def _frame_raster(self, request: TileRequest, z: int, geometry: GridGeometry) -> Raster:
        """Return the raster of a rectangle, with the cells of a level or with the finest stored cells if
        these are larger.
        """
        cells = TileCells(self._store, PRODUCTS[request.layer], request.state, self._viewsheds)

        def layers_of(level: int, grid: GridGeometry) -> Mapping[str, NDArray[Any]]:
            wide = with_margin(request.layer, grid)
            if request.layer in ANALYSES:
                return cells.analysed(request.layer, request.analysis, level, wide)
            return cells.read(level, wide)

        raster = _raster(request, layers_of(z, geometry), geometry.resolution_m)
        if raster.is_empty:
            coarse_z = cells.coarser_level(z, geometry)
            if coarse_z is not None:
                coarse = geometry.coarsened(1 << (z - coarse_z))
                enlarged = _raster(request, layers_of(coarse_z, coarse), coarse.resolution_m)
                x, y = geometry.centres_m()
                return enlarged.at(coarse, x, y)
        return raster

    def _body_raster(self, request: TileRequest, tile: BodyTile, location: FrameLocation) -> Raster:
        """Return the raster of a tile of the body's grid; empty far from the frame's origin."""
        x, y, cell = tile.points(location)
        known = np.isfinite(x)
        empty = np.zeros((TILE_CELLS, TILE_CELLS))
        if not known.any():
            return _raster(request, {}, 1.0, empty)
        z = min(LAST_LEVEL, max(0, ceil(LAST_LEVEL - log2(cell / FINEST_M) - 1e-6)))
        (x0, x1), (y0, y1) = (
            np.clip([np.nanmin(v), np.nanmax(v)], -HALF_SIDE_M, HALF_SIDE_M).tolist() for v in (x, y)
        )
        while (x1 - x0) * (y1 - y0) > _MOST_CELLS * cell_m(z) ** 2 and z > 0:
            z -= 1
        geometry = GridGeometry.aligned(request.frame, cell_m(z), (x0, y0, x1, y1))
        return self._frame_raster(request, z, geometry).at(geometry, x, y)

    def _add_to_cache(
        self, key: tuple[str, int, int, int], request: TileRequest, tile_data: RenderedTile, changes: int
    ) -> None:
        """Add a tile, unless maps have changed since ``changes`` was read."""
        with self._lock:
            tiles = self._cache.get(key, {})
            if self._changes != changes or request in tiles:
                return
            self._cache[key] = tiles | {request: tile_data}
            self._bytes += len(tile_data.data)
            while self._bytes > _CACHE_BYTES and len(self._cache) > 1:
                self._bytes -= _size(self._cache.popitem(last=False)[1])

    def _drop(self, change: Change) -> None:
        with self._lock:
            self._changes += 1
            self._others.clear()
            self._viewsheds.clear()
            for key in tiles_of_change(tuple(self._cache), change, margin_cells=1):
                tiles = self._cache.pop(key)
                remaining = {
                    request: tile_data
                    for request, tile_data in tiles.items()
                    if change.product not in (None, PRODUCTS[request.layer])
                }
                self._bytes -= _size(tiles) - _size(remaining)
                if remaining:
                    self._cache[key] = remaining


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """Values of a layer ``(rows, cols)``, NaN where unknown; or indices of a palette, 0 where unknown."""

    values: NDArray[Any]
    palette: NDArray[np.uint8] | None = None

    @property
    def is_empty(self) -> bool:
        """True if no cell is known."""
        return not (np.isfinite(self.values).any() if self.palette is None else self.values.any())

    def at(self, geometry: GridGeometry, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> Raster:
        """Return the values in the cells of a geometry that contain points ``(n, m)``."""
        rows, cols, inside = geometry.cells_of(x_m, y_m)
        unknown = np.nan if self.palette is None else 0
        return Raster(
            np.where(inside, self.values[rows, cols], self.values.dtype.type(unknown)), self.palette
        )


def render_elevation(
    layer: str,
    form: str,
    limits: tuple[float, float],
    layers: Mapping[str, NDArray[Any]],
    geometry: GridGeometry,
    place: Georeference | None,
) -> bytes:
    """Return the bytes of a layer as ``form``.

    Parameters
    ----------
    limits : tuple of float
        Values of the first and of the last colour.
    layers : mapping of str to array
        Of a navigation map, ``(rows, cols)``; else ``mean`` and ``variance`` of the height, metres and square
        metres, with a margin of one cell, ``(rows + 2, cols + 2)``, NaN where unobserved.
    geometry : GridGeometry
        Grid without the margin.
    place : Georeference or None
        CRS, for ``tif``.
    """
    raster = layer_raster(layer, form, limits, layers, geometry.resolution_m)
    return encoded_layer(layer, form, raster, geometry, place)


def layer_raster(
    layer: str,
    form: str,
    limits: tuple[float, float],
    layers: Mapping[str, NDArray[Any]],
    resolution_m: float,
) -> Raster:
    """Return a layer as values, or for ``png`` as indices; parameters as of ``render_elevation``."""
    if layer in NAVIGATION:
        values = NAVIGATION[layer].value(layers)
    elif layer == RELIEF and form == "png":
        return Raster(*relief(layers["mean"], resolution_m, *limits))
    elif layer in ANALYSES:
        values = layers["mean"][1:-1, 1:-1]
    else:
        rendering = RENDERINGS["elevation" if layer == RELIEF else layer]
        values = rendering.value(layers["mean"], layers["variance"], resolution_m)
    if form == "png":
        return Raster(indices(values, *limits), ALL_STYLES[layer].palette)
    return Raster(np.asarray(values, dtype=np.float32))


def encoded_layer(
    layer: str, form: str, raster: Raster, geometry: GridGeometry, place: Georeference | None
) -> bytes:
    """Return the bytes of a raster as ``form``; ``tif`` states a geometry and its CRS."""
    if raster.palette is not None:
        from cdff_common.formats.image import write_indexed_png

        return write_indexed_png(raster.values, raster.palette)
    if form == "bin":
        return np.ascontiguousarray(raster.values, dtype="<f4").tobytes()
    from cdff_common.formats.geotiff import write_bands

    return write_bands({layer: raster.values}, geometry, place=place, cloud_optimized=False)


def legend(layer: str, low: float | None = None, high: float | None = None) -> list[tuple[float, str]]:
    """Return values and the colours of them, ``#rrggbb``, from low to high."""
    limits, palette = range_of(layer, low, high), ALL_STYLES[layer].palette
    if layer == CLASSES:
        return [(float(i), _hex(palette[i])) for i in (1, 2, 3)]
    if layer == RELIEF:  # tints without shade
        palette = RENDERINGS["elevation"].palette
    return [
        (limits[0] + (limits[1] - limits[0]) * i / 8.0, _hex(palette[1 + round(254 * i / 8)]))
        for i in range(9)
    ]


def legend_png(layer: str, low: float | None = None, high: float | None = None) -> bytes:
    """Return a picture of the colours with the values of their ends; of classes with their names."""
    from PIL import Image, ImageDraw

    stops = legend(layer, low, high)
    picture = Image.new("RGB", _LEGEND_PX, "white")
    draw = ImageDraw.Draw(picture)
    width = _LEGEND_PX[0] - 20
    if layer == CLASSES:
        for i, (_, color) in enumerate(stops):
            draw.rectangle((10 + 80 * i, 8, 26 + 80 * i, 24), fill=color, outline="black")
            draw.text((32 + 80 * i, 10), ("safe", "caution", "hazard")[i], fill="black")
    else:
        values = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for _, c in stops], dtype=np.float64)
        at = np.linspace(0, len(stops) - 1, width)
        ramp = np.stack([np.interp(at, range(len(stops)), values[:, i]) for i in range(3)], axis=1)
        picture.paste(Image.fromarray(np.repeat(ramp[None].round().astype(np.uint8), 16, axis=0)), (10, 6))
        unit = ALL_STYLES[layer].unit
        draw.text((10, 26), f"{stops[0][0]:g}", fill="black")
        text = f"{stops[-1][0]:g} {'' if unit == '1' else unit}".strip()
        draw.text((_LEGEND_PX[0] - 10, 26), text, fill="black", anchor="ra")
    buffer = io.BytesIO()
    picture.save(buffer, "PNG")
    return buffer.getvalue()


def _hex(color: NDArray[np.uint8]) -> str:
    return "#" + "".join(f"{int(v):02x}" for v in color)


def with_margin(layer: str, geometry: GridGeometry) -> GridGeometry:
    """Return the cells that a layer is computed from: for elevation one more on each side."""
    if layer in NAVIGATION:
        return geometry
    return GridGeometry.from_cells(
        geometry.frame,
        geometry.resolution_m,
        left=geometry.left - 1,
        top=geometry.top + 1,
        rows=geometry.rows + 2,
        cols=geometry.cols + 2,
    )


def _raster(
    request: TileRequest,
    layers: Mapping[str, NDArray[Any]],
    resolution_m: float,
    unknown: NDArray[Any] | None = None,
) -> Raster:
    """Return the raster of a request; of the size of ``unknown``, without any cell, if it is given."""
    if unknown is not None:
        layers = {"class": unknown.astype(np.uint8)}
        if request.layer not in NAVIGATION:
            empty = np.full((unknown.shape[0] + 2, unknown.shape[1] + 2), np.nan, dtype=np.float32)
            layers = {"mean": empty, "variance": empty}
    return layer_raster(request.layer, request.form, request.range, layers, resolution_m)


def range_of(layer: str, low: float | None, high: float | None) -> tuple[float, float]:
    """Return the values of the first and last colour; raises InputError if low is not below high."""
    style = ALL_STYLES[layer]
    if layer == CLASSES and (low is not None or high is not None):
        raise InputError("low, high: classes have a colour each, and no range")
    limits = style.low if low is None else low, style.high if high is None else high
    if not limits[0] < limits[1]:
        raise InputError(f"low={limits[0]:g}, high={limits[1]:g}: expected low below high")
    return limits


def _size(tiles: dict[TileRequest, Any]) -> int:
    return sum(len(tile.data) for tile in tiles.values())
