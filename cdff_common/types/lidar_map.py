# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/lidar_map.asn by cdff generate; do not edit.

"""Types of ``asn1/lidar_map.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.lidar_map_ext import LidarMapCloudsExt, LidarMapExt, LidarMapPositionExt
from cdff_common.types.message import Message
from cdff_common.types.pose_graph import PoseGraph
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarMapMetadata(Message):
    """Type ``LidarMap-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 bytes
    sensor_id : str, at most 256 bytes
        frame of the lidar.
    time_stamp : Time
        of the newest sweep.
    """

    ASN1_NAME: ClassVar[str] = "LidarMap-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    sensor_id: str = ""
    time_stamp: Time = field(default_factory=Time)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarMapClouds(LidarMapCloudsExt):
    """Clouds of the graph's vertices, concatenated.

    Attributes
    ----------
    counts : NDArray[np.int64], shape (n,)
        number of points of each vertex, in the order of the graph's vertices.
    points : NDArray[np.float32], shape (n, 3)
        m, x y z in the frame of their vertex.
    """

    ASN1_NAME: ClassVar[str] = "LidarMap-Clouds"
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    points: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarMapPosition(LidarMapPositionExt):
    """Last pose of the lidar: no row, or one.

    Attributes
    ----------
    vertices : NDArray[np.int64], shape (n,)
        id of the vertex.
    poses : NDArray[np.float64], shape (n, 7)
        T_vertex_lidar: x y z (m), qx qy qz qw.
    """

    ASN1_NAME: ClassVar[str] = "LidarMap-Position"
    vertices: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarMap(LidarMapExt):
    """Keyframes: their poses, the measurements between them, and their clouds.

    Attributes
    ----------
    metadata : LidarMapMetadata
    graph : PoseGraph
    clouds : LidarMapClouds
    position : LidarMapPosition
    """

    ASN1_NAME: ClassVar[str] = "LidarMap"
    metadata: LidarMapMetadata = field(default_factory=LidarMapMetadata)
    graph: PoseGraph = field(default_factory=PoseGraph)
    clouds: LidarMapClouds = field(default_factory=LidarMapClouds)
    position: LidarMapPosition = field(default_factory=LidarMapPosition)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.metadata.time_stamp.ns
