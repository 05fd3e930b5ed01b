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

from cdff_common.types.frame import Array3D, Array3DDepthT, FrameErrorT
from cdff_common.types.map_ext import ElevationMapExt, GridLayerExt, MapExt, NavigationMapExt
from cdff_common.types.message import CapturedMessage, Message
from cdff_common.types.pose import TransformWithCovariance
from cdff_common.types.time import Time


class MapTypeT(IntEnum):
    """``Map-type-t``."""

    MAP_UNDEF = 0
    MAP_DEM = 1
    MAP_NAV = 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MapMetadataT(Message):
    """Type ``Map-metadata-t`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
    type : MapTypeT
    err_values : tuple[FrameErrorT, ...]
    scale : float
        m, edge of a cell.
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

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Map(MapExt):
    """Map of one layer in a frame, as in InFuse.

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

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.metadata.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GridMapMetadata(Message):
    """Row 0 is at yMax; cell edges are at multiples of the resolution from the frame's origin; a cell is
    an area.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    frame_id : str, at most 256 bytes
    start_time : Time
        t0: start of capture of the source data.
    end_time : Time
        t1: end of capture.
    resolution : float
        m, edge of a cell.
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

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.end_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GridLayer(GridLayerExt):
    """If the first layer of a map is named observed_cells, its data has one bit per cell (row-major, the
    first cell in the highest bit), and each other layer has its value in unobserved cells, followed by
    its values in the observed cells.

    Attributes
    ----------
    name : str, at most 256 bytes
        with its unit if it has one, e.g. slope_deg.
    depth : Array3DDepthT
    data : NDArray[np.uint8], shape (n,)
        rows x cols elements, row-major, little-endian.
    """

    ASN1_NAME: ClassVar[str] = "GridLayer"
    name: str = ""
    depth: Array3DDepthT = Array3DDepthT.DEPTH_8U
    data: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ElevationMap(ElevationMapExt, CapturedMessage):
    """Elevation map: layers mean, variance, min, max (m, m2), count, age_s (s before t1); NaN where
    unobserved.

    Attributes
    ----------
    metadata : GridMapMetadata
    layers : tuple[GridLayer, ...]
    """

    ASN1_NAME: ClassVar[str] = "ElevationMap"
    metadata: GridMapMetadata = field(default_factory=GridMapMetadata)
    layers: tuple[GridLayer, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class NavigationMap(NavigationMapExt, CapturedMessage):
    """Traversability map: layers class (0 unknown, 1 safe, 2 caution, 3 hazard), slope_deg, step_m,
    roughness_m, cost.

    Attributes
    ----------
    metadata : GridMapMetadata
    layers : tuple[GridLayer, ...]
    """

    ASN1_NAME: ClassVar[str] = "NavigationMap"
    metadata: GridMapMetadata = field(default_factory=GridMapMetadata)
    layers: tuple[GridLayer, ...] = ()
