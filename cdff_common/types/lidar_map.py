# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/lidar_map.asn by cdff generate; do not edit.

"""Types of ``asn1/lidar_map.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.lidar_map_ext import LidarMapCloudsExt, LidarMapExt, LidarMapPositionExt
from cdff_common.types.message import Message
from cdff_common.types.pose_graph import PoseGraph
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarMapMetadata(Message):
    """What a ``LidarMap-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 octets
    sensor_id : str, at most 256 octets
        frame of the lidar.
    time_stamp : Time
        of the newest sweep in it.
    """

    ASN1_NAME: ClassVar[str] = "LidarMap-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    sensor_id: str = ""
    time_stamp: Time = field(default_factory=Time)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "LidarMapMetadata.msg_version", 0, 4294967295))
        put(self, "producer_id", check.text(self.producer_id, "LidarMapMetadata.producer_id", 256))
        put(self, "sensor_id", check.text(self.sensor_id, "LidarMapMetadata.sensor_id", 256))
        put(self, "time_stamp", check.instance(self.time_stamp, "LidarMapMetadata.time_stamp", Time))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarMapClouds(LidarMapCloudsExt):
    """The clouds of the graph's vertices, one after the other.

    Attributes
    ----------
    counts : NDArray[np.int64], shape (n,)
        points of each vertex, in the order of the graph's vertices.
    points : NDArray[np.float32], shape (n, 3)
        m, x y z in the frame of their vertex.
    """

    ASN1_NAME: ClassVar[str] = "LidarMap-Clouds"
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    points: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "counts", check.typed_octets(self.counts, "LidarMapClouds.counts", 1073741824, "<i8", 0))
        put(self, "points", check.typed_octets(self.points, "LidarMapClouds.points", 1073741824, "<f4", 3))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarMapPosition(LidarMapPositionExt):
    """Where the lidar was last: none of each, or one.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "vertices", check.typed_octets(self.vertices, "LidarMapPosition.vertices", 1073741824, "<i8", 0))
        put(self, "poses", check.typed_octets(self.poses, "LidarMapPosition.poses", 1073741824, "<f8", 7))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarMap(LidarMapExt):
    """Key frames: poses, what was measured between them, and what was seen from each.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "LidarMap.metadata", LidarMapMetadata))
        put(self, "graph", check.instance(self.graph, "LidarMap.graph", PoseGraph))
        put(self, "clouds", check.instance(self.clouds, "LidarMap.clouds", LidarMapClouds))
        put(self, "position", check.instance(self.position, "LidarMap.position", LidarMapPosition))
        self._check_together()
