# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/mesh.asn by cdff generate; do not edit.

"""Types of ``asn1/mesh.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.mesh_ext import MeshDataExt, MeshExt
from cdff_common.types.message import FramedMessage, Message
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MeshMetadata(Message):
    """Type ``Mesh-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 bytes
    frame_id : str, at most 256 bytes
        frame of the vertices.
    time_stamp : Time
        end of capture of the source data.
    """

    ASN1_NAME: ClassVar[str] = "Mesh-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    frame_id: str = ""
    time_stamp: Time = field(default_factory=Time)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MeshData(MeshDataExt):
    """Type ``Mesh-Data`` of the ASN.1 modules.

    Attributes
    ----------
    vertices : NDArray[np.float64], shape (n, 3)
        m, x y z.
    triangles : NDArray[np.uint32], shape (n, 3)
        indices of vertices from 0, counter-clockwise seen from outside.
    normals : NDArray[np.float32], shape (n, 3)
        unit length, outwards; none or one per vertex.
    colors : NDArray[np.uint8], shape (n, 3)
        r g b; none or one per vertex.
    """

    ASN1_NAME: ClassVar[str] = "Mesh-Data"
    vertices: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    triangles: NDArray[np.uint32] = field(default_factory=lambda: np.zeros((0, 3), np.uint32))
    normals: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    colors: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), np.uint8))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Mesh(MeshExt, FramedMessage):
    """Triangle mesh in one frame.

    Attributes
    ----------
    metadata : MeshMetadata
    data : MeshData
    """

    ASN1_NAME: ClassVar[str] = "Mesh"
    metadata: MeshMetadata = field(default_factory=MeshMetadata)
    data: MeshData = field(default_factory=MeshData)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.metadata.time_stamp.ns
