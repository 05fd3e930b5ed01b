# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of maps: layers of a georeferenced grid."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types.frame import Array3DDepthT
from cdff_common.types.frame_ext import DEPTH_DTYPES, depth_of
from cdff_common.types.message import Box, Message
from cdff_common.types.pointcloud_ext import box_of_points
from cdff_common.types.time import Time

if TYPE_CHECKING:
    from cdff_common.types.frame import Array3D
    from cdff_common.types.map import GridLayer, GridMapMetadata, MapMetadataT


class GridLayerExt(Message):
    """One named layer."""

    __slots__ = ()
    if TYPE_CHECKING:
        name: str
        depth: Array3DDepthT
        data: NDArray[np.uint8]

    @classmethod
    def from_array(cls, name: str, array: NDArray[Any]) -> GridLayer:
        """Layer of an array ``(rows, cols)``."""
        from cdff_common.types.map import GridLayer

        depth = depth_of(array.dtype, f"layer {name}")
        dense = np.ascontiguousarray(array, dtype=DEPTH_DTYPES[depth])
        return GridLayer(name, depth, dense.reshape(-1).view(np.uint8))


class _LayeredMap(Message):
    """A grid of named layers."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: GridMapMetadata
        layers: tuple[GridLayer, ...]

    def _check_together(self) -> None:
        """Each layer has a name of its own and an element for each cell."""
        cells = self.metadata.rows * self.metadata.cols
        for layer in self.layers:
            size = np.dtype(DEPTH_DTYPES[layer.depth]).itemsize
            if len(layer.data) != cells * size:
                raise InputError(
                    f"{type(self).__name__} layer {layer.name!r}: {len(layer.data)} octets, expected {cells * size} "
                    f"for {self.metadata.rows}x{self.metadata.cols} cells"
                )
        if len(set(self.layer_names)) != len(self.layers):
            raise InputError(f"{type(self).__name__} layers {self.layer_names}: expected distinct names")

    @classmethod
    def from_layers(cls, geometry: GridGeometry, layers: Mapping[str, NDArray[Any]], *, t0_ns: int, t1_ns: int) -> Self:
        """Map of layers ``(rows, cols)`` of captures between ``t0_ns`` and ``t1_ns``.

        Raises
        ------
        InputError
            On a layer of another shape than the geometry's, or a dtype the wire has not.
        """
        from cdff_common.types.map import GridLayer, GridMapMetadata

        for name, array in layers.items():
            if array.shape != (geometry.rows, geometry.cols):
                raise InputError(f"layer {name!r}: shape {array.shape}, expected ({geometry.rows}, {geometry.cols})")
        metadata = GridMapMetadata(
            frame_id=geometry.frame,
            start_time=Time.from_ns(t0_ns),
            end_time=Time.from_ns(t1_ns),
            resolution=geometry.resolution_m,
            x_min=geometry.xmin_m,
            y_max=geometry.ymax_m,
            rows=geometry.rows,
            cols=geometry.cols,
        )
        made = tuple(GridLayer.from_array(name, array) for name, array in layers.items())
        return cls(metadata, made)  # type: ignore[call-arg]  # the generated dataclass takes metadata and layers

    @property
    def geometry(self) -> GridGeometry:
        """Where the cells lie."""
        m = self.metadata
        return GridGeometry(m.frame_id, m.resolution, m.x_min, m.y_max, m.rows, m.cols)

    @property
    def layer_names(self) -> tuple[str, ...]:
        """Names in order."""
        return tuple(layer.name for layer in self.layers)

    def layer(self, name: str) -> NDArray[Any]:
        """Read-only view ``(rows, cols)`` of a layer; raises InputError for a name that is not there."""
        for layer in self.layers:
            if layer.name == name:
                return layer.data.view(DEPTH_DTYPES[layer.depth]).reshape(self.metadata.rows, self.metadata.cols)
        raise InputError(f"{type(self).__name__} layer {name!r}: expected one of {', '.join(self.layer_names)}")

    @property
    def frame(self) -> str:
        """Frame of the map."""
        return self.metadata.frame_id

    @property
    def t0_ns(self) -> int:
        """Begin of capture, nanoseconds."""
        return self.metadata.start_time.ns

    @property
    def t1_ns(self) -> int:
        """End of capture, nanoseconds."""
        return self.metadata.end_time.ns

    @property
    def stamp_ns(self) -> int:
        """End of capture, nanoseconds."""
        return self.t1_ns

    def _heights(self) -> NDArray[Any] | None:
        """Heights that give the box its z, where the map has any."""
        return None

    def extent_m(self) -> Box | None:
        """Box of the whole grid in ``frame``; z of the heights, 0 where it has none."""
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
    """Where a rover may drive."""

    __slots__ = ()


class MapExt(Message):
    """InFuse's map: one array, its cell (0, 0) at the corner of largest y."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: MapMetadataT
        data: Array3D

    @property
    def stamp_ns(self) -> int:
        """Time of the map, nanoseconds."""
        return self.metadata.time_stamp.ns

    @property
    def frame(self) -> str:
        """Frame in which the map's pose is given."""
        return self.metadata.pose_fixed_frame_map_frame.parent_frame

    def extent_m(self) -> Box | None:
        """Box in ``frame`` around the corners of the map's plane; heights are not looked at."""
        if not self.data.rows or not self.data.cols:
            return None
        x, y = self.data.cols * self.metadata.scale, -self.data.rows * self.metadata.scale
        corners = np.array([[0.0, 0.0, 0.0], [x, 0.0, 0.0], [0.0, y, 0.0], [x, y, 0.0]])
        return box_of_points(self.metadata.pose_fixed_frame_map_frame.transform.apply(corners))
