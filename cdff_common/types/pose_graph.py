# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/pose_graph.asn by cdff generate; do not edit.

"""Types of ``asn1/pose_graph.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import FramedMessage, Message
from cdff_common.types.pose_graph_ext import PoseGraphEdgesExt, PoseGraphExt, PoseGraphVerticesExt
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseGraphMetadata(Message):
    """Type ``PoseGraph-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 bytes
    frame_id : str, at most 256 bytes
        frame of the vertices' poses.
    time_stamp : Time
        of the newest vertex.
    """

    ASN1_NAME: ClassVar[str] = "PoseGraph-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    frame_id: str = ""
    time_stamp: Time = field(default_factory=Time)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseGraphVertices(PoseGraphVerticesExt):
    """Columns of equal length: one row per vertex.

    Attributes
    ----------
    ids : NDArray[np.int64], shape (n,)
        unique.
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch.
    poses : NDArray[np.float64], shape (n, 7)
        T_frame_vertex: x y z (m), qx qy qz qw.
    fixed : NDArray[np.uint8], shape (n,)
        1 for a vertex that is not optimised; none or one per vertex.
    """

    ASN1_NAME: ClassVar[str] = "PoseGraph-Vertices"
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    fixed: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseGraphEdges(PoseGraphEdgesExt):
    """Columns of equal length: one row per edge.

    Attributes
    ----------
    ends : NDArray[np.int64], shape (n, 2)
        ids of the vertices a and b.
    poses : NDArray[np.float64], shape (n, 7)
        measured T_a_b: x y z (m), qx qy qz qw.
    information : NDArray[np.float64], shape (n, 36)
        inverse covariance of T_a_b, 6x6 rows: x y z rx ry rz, error in a (1/m2, 1/rad2).
    kinds : NDArray[np.uint8], shape (n,)
        0 odometry, 1 loop closure, 2 prior (a = b: T_frame_a); one per edge.
    """

    ASN1_NAME: ClassVar[str] = "PoseGraph-Edges"
    ends: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    information: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 36), np.float64))
    kinds: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseGraph(PoseGraphExt, FramedMessage):
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

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.metadata.time_stamp.ns
