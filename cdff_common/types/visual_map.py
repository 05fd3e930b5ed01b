# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/visual_map.asn by cdff generate; do not edit.

"""Types of ``asn1/visual_map.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.frame import Array3D
from cdff_common.types.message import Message
from cdff_common.types.pose_graph import PoseGraph
from cdff_common.types.time import Time
from cdff_common.types.visual_map_ext import VisualMapExt, VisualMapPointsExt


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VisualMapMetadata(Message):
    """Type ``VisualMap-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 bytes
    sensor_id : str, at most 256 bytes
        frame of the camera.
    time_stamp : Time
        of the newest keyframe.
    descriptor_type : str, at most 256 bytes
        ROOT_SIFT, ...
    """

    ASN1_NAME: ClassVar[str] = "VisualMap-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    sensor_id: str = ""
    time_stamp: Time = field(default_factory=Time)
    descriptor_type: str = ""

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VisualMapPoints(VisualMapPointsExt):
    """Points of the graph's vertices, concatenated; the other columns have one row per point.

    Attributes
    ----------
    counts : NDArray[np.int64], shape (n,)
        number of points of each vertex, in the order of the graph's vertices.
    positions : NDArray[np.float32], shape (n, 3)
        m, x y z in the frame of their vertex: camera x right, y down, z forward.
    depth_sigmas : NDArray[np.float32], shape (n,)
        m, standard deviation of the depth z.
    descriptors : Array3D
        one row per point.
    """

    ASN1_NAME: ClassVar[str] = "VisualMap-Points"
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    positions: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    depth_sigmas: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    descriptors: Array3D = field(default_factory=Array3D)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VisualMap(VisualMapExt):
    """Keyframes: their poses T_map_camera, the measurements between them, and their points.

    Attributes
    ----------
    metadata : VisualMapMetadata
    graph : PoseGraph
    points : VisualMapPoints
    """

    ASN1_NAME: ClassVar[str] = "VisualMap"
    metadata: VisualMapMetadata = field(default_factory=VisualMapMetadata)
    graph: PoseGraph = field(default_factory=PoseGraph)
    points: VisualMapPoints = field(default_factory=VisualMapPoints)
