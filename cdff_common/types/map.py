# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/map.asn by cdff generate; do not edit.

"""Types of ``asn1/map.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.frame import Array3D, Array3DDepthT, FrameErrorT
from cdff_common.types.map_ext import ElevationMapExt, GridLayerExt, MapExt, NavigationMapExt
from cdff_common.types.message import Message
from cdff_common.types.pose import TransformWithCovariance
from cdff_common.types.time import Time


class MapTypeT(IntEnum):
    """``Map-type-t``."""

    MAP_UNDEF = 0
    MAP_DEM = 1
    MAP_NAV = 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MapMetadataT(Message):
    """What a ``Map-metadata-t`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
    type : MapTypeT
    err_values : tuple[FrameErrorT, ...]
    scale : float
        m, side of a cell.
    pose_fixed_frame_map_frame : TransformWithCovariance
        of the outer corner of cell (0,0): row 0 has the largest y.
    """

    ASN1_NAME: ClassVar[str] = "Map-metadata-t"
    msg_version: int = 0
    time_stamp: Time = field(default_factory=Time)
    type: MapTypeT = MapTypeT.MAP_UNDEF
    err_values: tuple[FrameErrorT, ...] = ()
    scale: float = 0.0
    pose_fixed_frame_map_frame: TransformWithCovariance = field(default_factory=TransformWithCovariance)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "MapMetadataT.msg_version", 0, 4294967295))
        put(self, "time_stamp", check.instance(self.time_stamp, "MapMetadataT.time_stamp", Time))
        put(self, "type", check.enumeration(self.type, "MapMetadataT.type", MapTypeT))
        put(
            self,
            "err_values",
            check.items(
                self.err_values, "MapMetadataT.err_values", 0, 5, lambda v, w: check.instance(v, w, FrameErrorT)
            ),
        )
        put(self, "scale", check.real(self.scale, "MapMetadataT.scale"))
        put(
            self,
            "pose_fixed_frame_map_frame",
            check.instance(
                self.pose_fixed_frame_map_frame, "MapMetadataT.pose_fixed_frame_map_frame", TransformWithCovariance
            ),
        )

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Map(MapExt):
    """One layer in a frame, as InFuse knew it.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    metadata : MapMetadataT
    data : Array3D
    """

    ASN1_NAME: ClassVar[str] = "Map"
    msg_version: int = 0
    metadata: MapMetadataT = field(default_factory=MapMetadataT)
    data: Array3D = field(default_factory=Array3D)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "Map.msg_version", 0, 4294967295))
        put(self, "metadata", check.instance(self.metadata, "Map.metadata", MapMetadataT))
        put(self, "data", check.instance(self.data, "Map.data", Array3D))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GridMapMetadata(Message):
    """Row 0 lies at yMax; cell edges lie on multiples of the resolution from the frame's origin; a cell is an area.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    frame_id : str, at most 256 octets
    start_time : Time
        t0: begin of capture of what the map is made from.
    end_time : Time
        t1: end of it.
    resolution : float
        m, side of a cell.
    x_min : float
        m, outer edge of column 0.
    y_max : float
        m, outer edge of row 0.
    rows : int, 0..4294967295
    cols : int, 0..4294967295
    """

    ASN1_NAME: ClassVar[str] = "GridMap-Metadata"
    msg_version: int = 1
    frame_id: str = ""
    start_time: Time = field(default_factory=Time)
    end_time: Time = field(default_factory=Time)
    resolution: float = 0.0
    x_min: float = 0.0
    y_max: float = 0.0
    rows: int = 0
    cols: int = 0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "GridMapMetadata.msg_version", 0, 4294967295))
        put(self, "frame_id", check.text(self.frame_id, "GridMapMetadata.frame_id", 256))
        put(self, "start_time", check.instance(self.start_time, "GridMapMetadata.start_time", Time))
        put(self, "end_time", check.instance(self.end_time, "GridMapMetadata.end_time", Time))
        put(self, "resolution", check.real(self.resolution, "GridMapMetadata.resolution"))
        put(self, "x_min", check.real(self.x_min, "GridMapMetadata.x_min"))
        put(self, "y_max", check.real(self.y_max, "GridMapMetadata.y_max"))
        put(self, "rows", check.integer(self.rows, "GridMapMetadata.rows", 0, 4294967295))
        put(self, "cols", check.integer(self.cols, "GridMapMetadata.cols", 0, 4294967295))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GridLayer(GridLayerExt):
    """What a ``GridLayer`` of the ASN.1 modules holds.

    Attributes
    ----------
    name : str, at most 256 octets
        with its unit where it has one: slope_deg.
    depth : Array3DDepthT
    data : NDArray[np.uint8], shape (n,)
        rows x cols elements, row-major, little-endian.
    """

    ASN1_NAME: ClassVar[str] = "GridLayer"
    name: str = ""
    depth: Array3DDepthT = Array3DDepthT.DEPTH_8U
    data: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "name", check.text(self.name, "GridLayer.name", 256))
        put(self, "depth", check.enumeration(self.depth, "GridLayer.depth", Array3DDepthT))
        put(self, "data", check.octets(self.data, "GridLayer.data", 1073741824))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ElevationMap(ElevationMapExt):
    """Elevation: layers mean, variance, min, max (m, m2), count, age_s (s before t1); NaN where unobserved.

    Attributes
    ----------
    metadata : GridMapMetadata
    layers : tuple[GridLayer, ...]
    """

    ASN1_NAME: ClassVar[str] = "ElevationMap"
    metadata: GridMapMetadata = field(default_factory=GridMapMetadata)
    layers: tuple[GridLayer, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "ElevationMap.metadata", GridMapMetadata))
        put(
            self,
            "layers",
            check.items(self.layers, "ElevationMap.layers", 0, 64, lambda v, w: check.instance(v, w, GridLayer)),
        )
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class NavigationMap(NavigationMapExt):
    """Traversability: layers class (0 unknown, 1 safe, 2 caution, 3 hazard), slope_deg, step_m, roughness_m, cost.

    Attributes
    ----------
    metadata : GridMapMetadata
    layers : tuple[GridLayer, ...]
    """

    ASN1_NAME: ClassVar[str] = "NavigationMap"
    metadata: GridMapMetadata = field(default_factory=GridMapMetadata)
    layers: tuple[GridLayer, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "NavigationMap.metadata", GridMapMetadata))
        put(
            self,
            "layers",
            check.items(self.layers, "NavigationMap.layers", 0, 64, lambda v, w: check.instance(v, w, GridLayer)),
        )
        self._check_together()
