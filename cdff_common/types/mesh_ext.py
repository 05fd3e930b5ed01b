# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of meshes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.types.columns import check_columns
from cdff_common.types.message import Box, Message
from cdff_common.types.pointcloud_ext import box_of_points
from cdff_common.types.time import Time

if TYPE_CHECKING:
    from cdff_common.types.mesh import Mesh, MeshData, MeshMetadata


class MeshDataExt(Message):
    """Sizes and numbers that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        vertices: NDArray[np.float64]
        triangles: NDArray[np.uint32]
        normals: NDArray[np.float32]
        colors: NDArray[np.uint8]

    def _check_together(self) -> None:
        """Normals and colours are none or one for each vertex; triangles join vertices that are there."""
        n = len(self.vertices)
        check_columns("MeshData", n, {}, {"normals": self.normals, "colors": self.colors})
        if self.triangles.size and int(self.triangles.max()) >= n:
            raise InputError(f"MeshData.triangles: vertex {int(self.triangles.max())}, expected below {n}")


class MeshExt(Message):
    """A surface of triangles in one frame."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: MeshMetadata
        data: MeshData

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
    ) -> Mesh:
        """Mesh of vertices ``(n, 3)`` and triangles ``(m, 3)`` of their numbers, counter-clockwise from outside."""
        from cdff_common.types.mesh import Mesh, MeshData, MeshMetadata

        data = MeshData(
            np.asarray(vertices_m, dtype=np.float64).reshape(-1, 3),
            np.asarray(triangles).reshape(-1, 3),
            np.zeros((0, 3), np.float32) if normals is None else np.asarray(normals),
            np.zeros((0, 3), np.uint8) if colors is None else np.asarray(colors),
        )
        return Mesh(MeshMetadata(producer_id=producer, frame_id=frame, time_stamp=Time.from_ns(stamp_ns)), data)

    @property
    def frame(self) -> str:
        """Frame of the vertices."""
        return self.metadata.frame_id

    @property
    def stamp_ns(self) -> int:
        """End of capture of what it was made from, nanoseconds."""
        return self.metadata.time_stamp.ns

    def extent_m(self) -> Box | None:
        """Box around the finite vertices."""
        return box_of_points(self.data.vertices)
