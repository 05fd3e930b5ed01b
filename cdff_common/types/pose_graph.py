# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/pose_graph.asn by cdff generate; do not edit.

"""Types of ``asn1/pose_graph.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.message import Message
from cdff_common.types.pose_graph_ext import PoseGraphEdgesExt, PoseGraphExt, PoseGraphVerticesExt
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseGraphMetadata(Message):
    """What a ``PoseGraph-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 octets
    frame_id : str, at most 256 octets
        frame of the vertices' poses.
    time_stamp : Time
        of the newest vertex.
    """

    ASN1_NAME: ClassVar[str] = "PoseGraph-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    frame_id: str = ""
    time_stamp: Time = field(default_factory=Time)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "PoseGraphMetadata.msg_version", 0, 4294967295))
        put(self, "producer_id", check.text(self.producer_id, "PoseGraphMetadata.producer_id", 256))
        put(self, "frame_id", check.text(self.frame_id, "PoseGraphMetadata.frame_id", 256))
        put(self, "time_stamp", check.instance(self.time_stamp, "PoseGraphMetadata.time_stamp", Time))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseGraphVertices(PoseGraphVerticesExt):
    """Columns of one length: one row for each vertex.

    Attributes
    ----------
    ids : NDArray[np.int64], shape (n,)
        each once.
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch.
    poses : NDArray[np.float64], shape (n, 7)
        T_frame_vertex: x y z (m), qx qy qz qw.
    fixed : NDArray[np.uint8], shape (n,)
        1 where an optimiser may not move it; none or one for each vertex.
    """

    ASN1_NAME: ClassVar[str] = "PoseGraph-Vertices"
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    fixed: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ids", check.typed_octets(self.ids, "PoseGraphVertices.ids", 1073741824, "<i8", 0))
        put(self, "stamps", check.typed_octets(self.stamps, "PoseGraphVertices.stamps", 1073741824, "<i8", 0))
        put(self, "poses", check.typed_octets(self.poses, "PoseGraphVertices.poses", 1073741824, "<f8", 7))
        put(self, "fixed", check.typed_octets(self.fixed, "PoseGraphVertices.fixed", 1073741824, "<u1", 0))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseGraphEdges(PoseGraphEdgesExt):
    """Columns of one length: one row for each edge.

    Attributes
    ----------
    ends : NDArray[np.int64], shape (n, 2)
        ids of the vertices a and b.
    poses : NDArray[np.float64], shape (n, 7)
        measured T_a_b: x y z (m), qx qy qz qw.
    information : NDArray[np.float64], shape (n, 36)
        inverse covariance of T_a_b, 6x6 rows: x y z rx ry rz, error in a (1/m2, 1/rad2).
    kinds : NDArray[np.uint8], shape (n,)
        0 odometry, 1 loop closure, 2 prior (a = b: T_frame_a); one for each edge.
    """

    ASN1_NAME: ClassVar[str] = "PoseGraph-Edges"
    ends: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    information: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 36), np.float64))
    kinds: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ends", check.typed_octets(self.ends, "PoseGraphEdges.ends", 1073741824, "<i8", 2))
        put(self, "poses", check.typed_octets(self.poses, "PoseGraphEdges.poses", 1073741824, "<f8", 7))
        put(
            self,
            "information",
            check.typed_octets(self.information, "PoseGraphEdges.information", 1073741824, "<f8", 36),
        )
        put(self, "kinds", check.typed_octets(self.kinds, "PoseGraphEdges.kinds", 1073741824, "<u1", 0))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseGraph(PoseGraphExt):
    """Vertices, and edges between them.

    Attributes
    ----------
    metadata : PoseGraphMetadata
    vertices : PoseGraphVertices
    edges : PoseGraphEdges
    """

    ASN1_NAME: ClassVar[str] = "PoseGraph"
    metadata: PoseGraphMetadata = field(default_factory=PoseGraphMetadata)
    vertices: PoseGraphVertices = field(default_factory=PoseGraphVertices)
    edges: PoseGraphEdges = field(default_factory=PoseGraphEdges)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "PoseGraph.metadata", PoseGraphMetadata))
        put(self, "vertices", check.instance(self.vertices, "PoseGraph.vertices", PoseGraphVertices))
        put(self, "edges", check.instance(self.edges, "PoseGraph.edges", PoseGraphEdges))
        self._check_together()
