# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of meshes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.types.message import Message


class MeshDataExt(Message):
    """One row per vertex, and triangles of existing vertices."""

    __slots__ = ()
    vertices: NDArray[np.float64]
    triangles: NDArray[np.uint32]

    def _check_consistency(self) -> None:
        """Check the columns and the vertices of the triangles."""
        Message._check_consistency(self)
        n = len(self.vertices)
        if self.triangles.size and int(self.triangles.max()) >= n:
            raise InputError(f"MeshData.triangles: vertex {int(self.triangles.max())}, expected below {n}")


class MeshExt(Message):
    """Triangle mesh in one frame."""

    __slots__ = ()
    metadata: types.MeshMetadata
    data: types.MeshData

    @classmethod
    def from_arrays(
        cls,
        vertices_m: ArrayLike,
        triangles: ArrayLike,
        *,
        frame: str,
        stamp_ns: int,
        normals: ArrayLike | None = None,
        colors: ArrayLike | None = None,
        producer: str = "",
    ) -> types.Mesh:
        """Return the mesh of vertices ``(n, 3)`` and index triangles ``(m, 3)``, counter-clockwise from
        outside.
        """
        data = types.MeshData(
            np.asarray(vertices_m, dtype=np.float64).reshape(-1, 3),
            np.asarray(triangles).reshape(-1, 3),
            np.zeros((0, 3), np.float32) if normals is None else np.asarray(normals),
            np.zeros((0, 3), np.uint8) if colors is None else np.asarray(colors),
        )
        return types.Mesh(
            types.MeshMetadata(producer_id=producer, frame_id=frame, time_stamp=types.Time.from_ns(stamp_ns)),
            data,
        )
