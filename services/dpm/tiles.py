# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tiles of elevation and navigation: as PNG, or their values as GeoTIFF or plain float32; kept until they change."""

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
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.rendering import NAVIGATION, RELIEF_LOOK, RENDERINGS, Look, indices, relief
from cdff_common.raster.tiles import Tile
from dpm_store import Store
from dpm_store.pyramid import Change, touched

#: The relief is drawn in colours; its values are heights.
RELIEF = "dem"
CLASSES = "navigation_map"
#: Layers of tiles by name, and the product that each is made from.
LOOKS: dict[str, Look] = {RELIEF: RELIEF_LOOK, **RENDERINGS, **NAVIGATION}
LAYERS = {name: "navigation_map" if name in NAVIGATION else "dem" for name in LOOKS}
MEDIA_TYPES = {"png": "image/png", "tif": "image/tiff; application=geotiff", "bin": "application/octet-stream"}
_KEPT_BYTES = 32 << 20


@dataclass(frozen=True, slots=True)
class TileRequest:
    """One tile as it is asked for: raises InputError for a layer, form or range that there is not.

    Attributes
    ----------
    low, high : float or None
        Range of the colours, in the layer's unit; the layer's own without.
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
    """Bytes of a tile and the tag by which a client knows whether it has them."""

    data: bytes
    media_type: str
    etag: str


class Tiles:
    """Renders tiles of a store and keeps them until something in them changes."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._kept: OrderedDict[tuple[str, int, int, int], dict[TileRequest, RenderedTile]] = OrderedDict()
        self._bytes = 0
        store.pyramid.listen(self._forget)

    def get(self, asked: TileRequest) -> RenderedTile:
        """One tile; transparent, or NaN, where nothing of its cells' size or finer was observed."""
        pyramid, tile = self._store.pyramid, asked.tile
        before = pyramid.sync()
        key = (asked.frame, tile.z, tile.x, tile.y)
        with self._lock:
            known = self._kept.get(key, {}).get(asked)
            if known is not None:
                self._kept.move_to_end(key)
                return known
        wkt = self._store.places.of(asked.frame).wkt if asked.form == "tif" else None
        geometry = tile.geometry(asked.frame)
        if asked.layer in NAVIGATION:
            navigation = self._store.maps.navigation
            layers = pyramid.settled(asked.frame, lambda: navigation.tile(asked.frame, tile))
            data = drawn_judgement(asked.layer, asked.form, asked.range, layers, geometry, wkt)
        else:
            layers = pyramid.statistics(asked.frame, tile.z, tile.geometry(asked.frame, margin=1)).to_layers(0)
            data = drawn(asked.layer, asked.form, asked.range, layers["mean"], layers["variance"], geometry, wkt)
        etag = f'"{hashlib.blake2b(data, digest_size=12).hexdigest()}"'
        made = RenderedTile(data, MEDIA_TYPES[asked.form], etag)
        if pyramid.sync() == before:
            self._keep(key, asked, made)
        return made

    def _keep(self, key: tuple[str, int, int, int], asked: TileRequest, made: RenderedTile) -> None:
        with self._lock:
            self._kept.setdefault(key, {})[asked] = made
            self._bytes += len(made.data)
            while self._bytes > _KEPT_BYTES and len(self._kept) > 1:
                self._bytes -= _size(self._kept.popitem(last=False)[1])

    def _forget(self, change: Change) -> None:
        with self._lock:
            for key in touched(tuple(self._kept), change, margin_cells=1):
                tiles = self._kept.pop(key)
                left = {
                    asked: made for asked, made in tiles.items() if change.product not in (None, LAYERS[asked.layer])
                }
                self._bytes -= _size(tiles) - _size(left)
                if left:
                    self._kept[key] = left


def drawn(
    layer: str, form: str, limits: tuple[float, float], mean: NDArray[np.float32], variance: NDArray[np.float32],
    geometry: GridGeometry, wkt: str | None,
) -> bytes:  # fmt: skip
    """Bytes of a layer as ``form``.

    Parameters
    ----------
    limits : tuple of float
        Values of the first and of the last colour.
    mean, variance : array, shape (rows + 2, cols + 2)
        Of the height, metres and square metres, with a margin of one cell; NaN where unobserved.
    geometry : GridGeometry
        Without the margin.
    wkt : str or None
        CRS, for ``tif``.
    """
    resolution_m = geometry.resolution_m
    if layer == RELIEF and form == "png":
        from cdff_common.formats.image import write_indexed_png

        return write_indexed_png(*relief(mean, resolution_m, *limits))
    rendering = RENDERINGS["elevation" if layer == RELIEF else layer]
    return _written(layer, form, limits, rendering.value(mean, variance, resolution_m), geometry, wkt)


def drawn_judgement(
    layer: str, form: str, limits: tuple[float, float], layers: Mapping[str, NDArray[Any]], geometry: GridGeometry,
    wkt: str | None,
) -> bytes:  # fmt: skip
    """As ``drawn``, of the layers ``(rows, cols)`` of a navigation map."""
    return _written(layer, form, limits, NAVIGATION[layer].value(layers), geometry, wkt)


def _written(
    layer: str, form: str, limits: tuple[float, float], values: NDArray[np.float32], geometry: GridGeometry,
    wkt: str | None,
) -> bytes:  # fmt: skip
    if form == "png":
        from cdff_common.formats.image import write_indexed_png

        return write_indexed_png(indices(values, *limits), LOOKS[layer].palette)
    if form == "bin":
        return np.ascontiguousarray(values, dtype="<f4").tobytes()
    from cdff_common.formats.geotiff import write_bands

    return write_bands({layer: values}, geometry, wkt=wkt, cloud_optimized=False)


def range_of(layer: str, low: float | None, high: float | None) -> tuple[float, float]:
    """Values of the first and of the last colour; raises InputError where they are not in this order."""
    usual = LOOKS[layer]
    if layer == CLASSES and (low is not None or high is not None):
        raise InputError("low, high: classes have a colour each, and no range")
    limits = usual.low if low is None else low, usual.high if high is None else high
    if not limits[0] < limits[1]:
        raise InputError(f"low={limits[0]:g}, high={limits[1]:g}: expected low below high")
    return limits


def _size(tiles: dict[TileRequest, Any]) -> int:
    return sum(len(tile.data) for tile in tiles.values())
