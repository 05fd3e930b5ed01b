# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tiles of elevation and navigation: as PNG, or their values as GeoTIFF or plain float32; cached until
they change.
"""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geodesy import Georeference
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.rendering import NAVIGATION, RELIEF_STYLE, RENDERINGS, LayerStyle, indices, relief
from cdff_common.raster.tiles import Tile
from dpm_store import Store
from dpm_store.maps.tile_changes import Change, tiles_of_change

#: Layer of the coloured relief; its values are heights.
RELIEF = "dem"
CLASSES = "navigation_map"
#: Style and product type of each tile layer.
LAYER_STYLES: dict[str, LayerStyle] = {RELIEF: RELIEF_STYLE, **RENDERINGS, **NAVIGATION}
LAYERS = {name: "navigation_map" if name in NAVIGATION else "dem" for name in LAYER_STYLES}
MEDIA_TYPES = {
    "png": "image/png",
    "tif": "image/tiff; application=geotiff",
    "bin": "application/octet-stream",
}
_CACHE_BYTES = 32 << 20


@dataclass(frozen=True, slots=True)
class TileRequest:
    """A requested tile; raises InputError for an unknown layer, form or range.

    Attributes
    ----------
    low, high : float or None
        Range of the colours, in the layer's unit; None for the default of the layer.
    """

    frame: str
    layer: str
    tile: Tile
    form: str = "png"
    low: float | None = None
    high: float | None = None

    def __post_init__(self) -> None:
        if self.layer not in LAYERS:
            raise InputError(f"layer={self.layer[:40]!r}: expected one of {', '.join(LAYERS)}")
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
        self._bytes = self._changes = 0
        store.pyramid.listen(self._drop)

    def get(self, request: TileRequest) -> RenderedTile:
        """Return one tile; transparent, or NaN, where unobserved at its cell size."""
        pyramid, tile = self._store.pyramid, request.tile
        pyramid.sync()
        key = (request.frame, tile.z, tile.x, tile.y)
        with self._lock:
            changes = self._changes
            cached = self._cache.get(key, {}).get(request)
            if cached is not None:
                self._cache.move_to_end(key)
                return cached
        place = self._store.anchors.of(request.frame).georeference if request.form == "tif" else None
        geometry = tile.geometry(request.frame)
        if request.layer in NAVIGATION:
            navigation = self._store.maps.navigation
            layers = pyramid.without_changes(request.frame, lambda: navigation.tile(request.frame, tile))
        else:
            with_margin = tile.geometry(request.frame, margin=1)
            layers = pyramid.statistics(request.frame, tile.z, with_margin).to_layers(0)
        data = render_elevation(request.layer, request.form, request.range, layers, geometry, place)
        etag = f'"{hashlib.blake2b(data, digest_size=12).hexdigest()}"'
        tile_data = RenderedTile(data, MEDIA_TYPES[request.form], etag)
        self._add_to_cache(key, request, tile_data, changes)
        return tile_data

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
            for key in tiles_of_change(tuple(self._cache), change, margin_cells=1):
                tiles = self._cache.pop(key)
                remaining = {
                    request: tile_data
                    for request, tile_data in tiles.items()
                    if change.product not in (None, LAYERS[request.layer])
                }
                self._bytes -= _size(tiles) - _size(remaining)
                if remaining:
                    self._cache[key] = remaining


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
    from cdff_common.formats.image import write_indexed_png

    if layer in NAVIGATION:
        values = NAVIGATION[layer].value(layers)
    elif layer == RELIEF and form == "png":
        return write_indexed_png(*relief(layers["mean"], geometry.resolution_m, *limits))
    else:
        rendering = RENDERINGS["elevation" if layer == RELIEF else layer]
        values = rendering.value(layers["mean"], layers["variance"], geometry.resolution_m)
    if form == "png":
        return write_indexed_png(indices(values, *limits), LAYER_STYLES[layer].palette)
    if form == "bin":
        return np.ascontiguousarray(values, dtype="<f4").tobytes()
    from cdff_common.formats.geotiff import write_bands

    return write_bands({layer: values}, geometry, place=place, cloud_optimized=False)


def range_of(layer: str, low: float | None, high: float | None) -> tuple[float, float]:
    """Return the values of the first and last colour; raises InputError if low is not below high."""
    style = LAYER_STYLES[layer]
    if layer == CLASSES and (low is not None or high is not None):
        raise InputError("low, high: classes have a colour each, and no range")
    limits = style.low if low is None else low, style.high if high is None else high
    if not limits[0] < limits[1]:
        raise InputError(f"low={limits[0]:g}, high={limits[1]:g}: expected low below high")
    return limits


def _size(tiles: dict[TileRequest, Any]) -> int:
    return sum(len(tile.data) for tile in tiles.values())
