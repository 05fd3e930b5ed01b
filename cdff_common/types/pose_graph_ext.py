# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of a pose graph."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.types.columns import check_columns, check_unique, pack_poses, pack_squares, stamps_us, unpack_poses
from cdff_common.types.message import Box, Message
from cdff_common.types.pointcloud_ext import box_of_points
from cdff_common.types.time import Time

if TYPE_CHECKING:
    from cdff_common.types.pose_graph import PoseGraph, PoseGraphEdges, PoseGraphMetadata, PoseGraphVertices

#: Kinds of edges.
ODOMETRY, LOOP_CLOSURE, PRIOR = 0, 1, 2


class PoseGraphVerticesExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        ids: NDArray[np.int64]
        stamps: NDArray[np.int64]
        poses: NDArray[np.float64]
        fixed: NDArray[np.uint8]

    def _check_together(self) -> None:
        """One stamp and one pose for each vertex, and each vertex once."""
        whole: dict[str, NDArray[Any]] = {"stamps": self.stamps, "poses": self.poses}
        check_columns("PoseGraphVertices", len(self.ids), whole, {"fixed": self.fixed})
        check_unique("PoseGraphVertices.ids", self.ids)

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Times ``(n,)``, nanoseconds."""
        return self.stamps * 1000

    @property
    def matrices(self) -> NDArray[np.float64]:
        """``T_frame_vertex (n, 4, 4)``."""
        return unpack_poses(self.poses, "PoseGraphVertices")


class PoseGraphEdgesExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        ends: NDArray[np.int64]
        poses: NDArray[np.float64]
        information: NDArray[np.float64]
        kinds: NDArray[np.uint8]

    def _check_together(self) -> None:
        """One pose, information and kind for each edge."""
        whole: dict[str, NDArray[Any]] = {
            "poses": self.poses,
            "information": self.information,
            "kinds": self.kinds,
        }
        check_columns("PoseGraphEdges", len(self.ends), whole, {})

    @property
    def matrices(self) -> NDArray[np.float64]:
        """Measured ``T_a_b (n, 4, 4)``."""
        return unpack_poses(self.poses, "PoseGraphEdges")

    @property
    def information_matrices(self) -> NDArray[np.float64]:
        """``(n, 6, 6)``: x y z rx ry rz, error in a."""
        return self.information.reshape(-1, 6, 6)


class PoseGraphExt(Message):
    """Poses in one frame, and what was measured between them."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: PoseGraphMetadata
        vertices: PoseGraphVertices
        edges: PoseGraphEdges

    def _check_together(self) -> None:
        """Edges end at vertices that are there."""
        missing = np.setdiff1d(self.edges.ends, self.vertices.ids)
        if missing.size:
            raise InputError(f"PoseGraphEdges.ends: vertex {missing[0]} is not in the graph")

    @classmethod
    def from_arrays(
        cls,
        ids: ArrayLike,
        stamps_ns: ArrayLike,
        matrices: ArrayLike,
        ends: ArrayLike,
        edge_matrices: ArrayLike,
        information: ArrayLike,
        kinds: ArrayLike,
        *,
        frame: str,
        fixed: ArrayLike | None = None,
        producer: str = "",
    ) -> PoseGraph:
        """Graph of ``n`` vertices and ``m`` edges.

        Parameters
        ----------
        ids, stamps_ns : array_like of int, shape (n,)
            Each id once; times in multiples of 1000 ns.
        matrices : array_like, shape (n, 4, 4)
            ``T_frame_vertex``, metres.
        ends : array_like of int, shape (m, 2)
            Ids of the vertices a and b of each edge.
        edge_matrices, information : array_like, shape (m, 4, 4) and (m, 6, 6)
            Measured ``T_a_b`` and its inverse covariance: x y z rx ry rz, error in a.
        kinds : array_like of int, shape (m,)
            ``ODOMETRY``, ``LOOP_CLOSURE`` or ``PRIOR``.
        fixed : array_like of bool, shape (n,), optional
            Vertices that an optimiser may not move.

        Raises
        ------
        InputError
            On sizes that differ, ids that are there twice or not at all, or matrices that are not rigid.
        """
        from cdff_common.types.pose_graph import PoseGraph, PoseGraphEdges, PoseGraphMetadata, PoseGraphVertices

        stamps = stamps_us(stamps_ns, "PoseGraph stamps")
        vertices = PoseGraphVertices(
            np.asarray(ids, dtype=np.int64),
            stamps,
            pack_poses(matrices, "PoseGraph vertex"),
            np.zeros(0, np.uint8) if fixed is None else np.asarray(fixed).astype(np.uint8),
        )
        edge_poses = pack_poses(edge_matrices, "PoseGraph edge")
        edges = PoseGraphEdges(
            np.asarray(ends, dtype=np.int64).reshape(-1, 2),
            edge_poses,
            pack_squares(information, len(edge_poses), 6, "PoseGraph information"),
            np.asarray(kinds, dtype=np.uint8),
        )
        newest = Time(int(stamps.max())) if stamps.size else Time()
        return PoseGraph(PoseGraphMetadata(producer_id=producer, frame_id=frame, time_stamp=newest), vertices, edges)

    @property
    def frame(self) -> str:
        """Frame of the vertices' poses."""
        return self.metadata.frame_id

    @property
    def stamp_ns(self) -> int:
        """Time of the newest vertex, nanoseconds."""
        return self.metadata.time_stamp.ns

    def extent_m(self) -> Box | None:
        """Box around the vertices' positions."""
        return box_of_points(self.vertices.poses[:, :3])
