# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of a pose graph."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.types.columns import pack_poses, pack_squares, stamps_us, unpack_poses
from cdff_common.types.message import Message

#: Kinds of edges.
ODOMETRY, LOOP_CLOSURE, PRIOR = 0, 1, 2


class PoseGraphVerticesExt(Message):
    """One row per vertex."""

    __slots__ = ()
    stamps: NDArray[np.int64]
    poses: NDArray[np.float64]

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Times ``(n,)``, nanoseconds."""
        return self.stamps * 1000

    @property
    def matrices(self) -> NDArray[np.float64]:
        """``T_frame_vertex (n, 4, 4)``."""
        return unpack_poses(self.poses, "PoseGraphVertices")


class PoseGraphEdgesExt(Message):
    """One row per edge."""

    __slots__ = ()
    poses: NDArray[np.float64]
    information: NDArray[np.float64]

    @property
    def matrices(self) -> NDArray[np.float64]:
        """Measured ``T_a_b (n, 4, 4)``."""
        return unpack_poses(self.poses, "PoseGraphEdges")

    @property
    def information_matrices(self) -> NDArray[np.float64]:
        """``(n, 6, 6)``: x y z rx ry rz, error in a."""
        return self.information.reshape(-1, 6, 6)


class PoseGraphExt(Message):
    """Poses in one frame, and measurements between them."""

    __slots__ = ()
    metadata: types.PoseGraphMetadata
    vertices: types.PoseGraphVertices
    edges: types.PoseGraphEdges

    def _check_consistency(self) -> None:
        """Check that the vertices of the edges exist."""
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
    ) -> types.PoseGraph:
        """Return the graph of ``n`` vertices and ``m`` edges.

        Parameters
        ----------
        ids, stamps_ns : array_like of int, shape (n,)
            Unique ids; times in multiples of 1000 ns.
        matrices : array_like, shape (n, 4, 4)
            ``T_frame_vertex``, metres.
        ends : array_like of int, shape (m, 2)
            Ids of the vertices a and b of each edge.
        edge_matrices, information : array_like, shape (m, 4, 4) and (m, 6, 6)
            Measured ``T_a_b`` and its inverse covariance: x y z rx ry rz, error in a.
        kinds : array_like of int, shape (m,)
            ``ODOMETRY``, ``LOOP_CLOSURE`` or ``PRIOR``.
        fixed : array_like of bool, shape (n,), optional
            Vertices that are not optimised.

        Raises
        ------
        InputError
            If array lengths differ, ids are repeated or missing, or a matrix is not a rigid transform.
        """
        stamps = stamps_us(stamps_ns, "PoseGraph stamps")
        vertices = types.PoseGraphVertices(
            np.asarray(ids, dtype=np.int64),
            stamps,
            pack_poses(matrices, "PoseGraph vertex"),
            np.zeros(0, np.uint8) if fixed is None else np.asarray(fixed).astype(np.uint8),
        )
        edge_poses = pack_poses(edge_matrices, "PoseGraph edge")
        edges = types.PoseGraphEdges(
            np.asarray(ends, dtype=np.int64).reshape(-1, 2),
            edge_poses,
            pack_squares(information, len(edge_poses), 6, "PoseGraph information"),
            np.asarray(kinds, dtype=np.uint8),
        )
        newest = types.Time(int(stamps.max())) if stamps.size else types.Time()
        return types.PoseGraph(
            types.PoseGraphMetadata(producer_id=producer, frame_id=frame, time_stamp=newest), vertices, edges
        )
