# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of maps: layers of a georeferenced grid."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types.frame_ext import DEPTH_DTYPES, depth_of
from cdff_common.types.message import Box, Message, box_around
from cdff_common.types.summary import array_text

#: Name of the first layer of a map in compact form, see ``cdff_common.codecs.compact_maps``.
OBSERVED_CELLS = "observed_cells"


class GridLayerExt(Message):
    """Named layer of a map."""

    __slots__ = ()
    name: str
    depth: types.Array3DDepthT
    data: NDArray[np.uint8]

    @classmethod
    def from_array(cls, name: str, array: NDArray[Any]) -> types.GridLayer:
        """Return the layer of an array ``(rows, cols)``."""
        depth = depth_of(array.dtype, f"layer {name}")
        dense = np.ascontiguousarray(array, dtype=DEPTH_DTYPES[depth])
        return types.GridLayer(name, depth, dense.reshape(-1).view(np.uint8))

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the elements."""
        return np.dtype(DEPTH_DTYPES[self.depth])

    def __repr__(self) -> str:
        """Return name, dtype and range of the layer."""
        cells = self.data if len(self.data) % self.dtype.itemsize else self.data.view(self.dtype)
        return f"GridLayer({self.name!r}, {array_text(cells)})"


class _LayeredMap(Message):
    """Grid of named layers."""

    __slots__ = ()
    metadata: types.GridMapMetadata
    layers: tuple[types.GridLayer, ...]

    def _check_consistency(self) -> None:
        """Check for unique names and one element per cell, in the compact form per observed cell."""
        cells = self.metadata.rows * self.metadata.cols
        layers, of = self.layers, f"{self.metadata.rows}x{self.metadata.cols} cells"
        if self.is_compact:
            bits, layers = layers[0], layers[1:]
            if len(bits.data) != -(-cells // 8) or bits.dtype != np.uint8:
                raise InputError(
                    f"{type(self).__name__} layer {bits.name!r}: {len(bits.data)} bytes of {bits.dtype}, "
                    f"expected {-(-cells // 8)} of uint8, one bit for each of {of}"
                )
            cells = 1 + int(np.count_nonzero(np.unpackbits(bits.data, count=cells)))
            of = f"{cells - 1} observed cells and the value of the others"
        for layer in layers:
            if len(layer.data) != cells * layer.dtype.itemsize:
                raise InputError(
                    f"{type(self).__name__} layer {layer.name!r}: {len(layer.data)} bytes, "
                    f"expected {cells * layer.dtype.itemsize} for {of}"
                )
        if len(set(self.layer_names)) != len(self.layers):
            raise InputError(f"{type(self).__name__} layers {self.layer_names}: expected distinct names")

    @classmethod
    def from_layers(
        cls, geometry: GridGeometry, layers: Mapping[str, NDArray[Any]], *, t0_ns: int, t1_ns: int
    ) -> Self:
        """Return the map of layers ``(rows, cols)`` of captures between ``t0_ns`` and ``t1_ns``.

        Raises
        ------
        InputError
            If the shape of a layer differs from the geometry, its dtype is not supported, or its name is
            that of the compact form.
        """
        if OBSERVED_CELLS in layers:
            raise InputError(f"layer {OBSERVED_CELLS!r}: expected another name, it is that of a compact map")
        for name, array in layers.items():
            if array.shape != (geometry.rows, geometry.cols):
                raise InputError(
                    f"layer {name!r}: shape {array.shape}, expected ({geometry.rows}, {geometry.cols})"
                )
        metadata = types.GridMapMetadata(
            frame_id=geometry.frame,
            start_time=types.Time.from_ns(t0_ns),
            end_time=types.Time.from_ns(t1_ns),
            resolution=geometry.resolution_m,
            x_min=geometry.xmin_m,
            y_max=geometry.ymax_m,
            rows=geometry.rows,
            cols=geometry.cols,
        )
        grid_layers = tuple(types.GridLayer.from_array(name, array) for name, array in layers.items())
        return cls(metadata, grid_layers)  # type: ignore[call-arg]

    @property
    def geometry(self) -> GridGeometry:
        """Geometry of the cells."""
        m = self.metadata
        return GridGeometry(m.frame_id, m.resolution, m.x_min, m.y_max, m.rows, m.cols)

    @property
    def is_compact(self) -> bool:
        """True if the layers contain the observed cells only; ``decode`` returns no such maps."""
        return bool(self.layers) and self.layers[0].name == OBSERVED_CELLS

    @property
    def layer_names(self) -> tuple[str, ...]:
        """Names of the layers, in order."""
        return tuple(layer.name for layer in self.layers)

    def layer(self, name: str) -> NDArray[Any]:
        """Return a read-only view ``(rows, cols)`` of a layer; raises InputError for an unknown name."""
        for layer in self.layers:
            if layer.name == name:
                return layer.data.view(layer.dtype).reshape(self.metadata.rows, self.metadata.cols)
        raise InputError(
            f"{type(self).__name__} layer {name!r}: expected one of {', '.join(self.layer_names)}"
        )

    def _heights(self) -> NDArray[Any] | None:
        """Return the heights for the z range of the box, or None."""
        return None

    def extent_m(self) -> Box | None:
        """Return the box of the whole grid in ``frame``; z of the heights, else 0."""
        m = self.metadata
        if m.rows == 0 or m.cols == 0:
            return None
        heights = self._heights()
        finite = np.zeros(0) if heights is None else heights[np.isfinite(heights)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        x1, y0 = m.x_min + m.cols * m.resolution, m.y_max - m.rows * m.resolution
        return (m.x_min, y0, low, x1, m.y_max, high)


class ElevationMapExt(_LayeredMap):
    """Heights with their statistics."""

    __slots__ = ()

    def _heights(self) -> NDArray[Any] | None:
        return self.layer("mean") if "mean" in self.layer_names else None


class NavigationMapExt(_LayeredMap):
    """Traversability of the ground."""

    __slots__ = ()


class MapExt(Message):
    """Map of InFuse: one array with cell (0, 0) at the corner of largest y."""

    __slots__ = ()
    metadata: types.MapMetadataT
    data: types.Array3D

    @property
    def frame(self) -> str:
        """Parent frame of the map's pose."""
        return self.metadata.pose_fixed_frame_map_frame.parent_frame

    def extent_m(self) -> Box | None:
        """Return the box in ``frame`` around the corners of the map plane, without heights."""
        if not self.data.rows or not self.data.cols:
            return None
        x, y = self.data.cols * self.metadata.scale, -self.data.rows * self.metadata.scale
        corners = np.array([[0.0, 0.0, 0.0], [x, 0.0, 0.0], [0.0, y, 0.0], [x, y, 0.0]])
        return box_around(self.metadata.pose_fixed_frame_map_frame.transform.apply(corners))
