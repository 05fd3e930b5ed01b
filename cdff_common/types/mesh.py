# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/mesh.asn by cdff generate; do not edit.

"""Types of ``asn1/mesh.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.mesh_ext import MeshDataExt, MeshExt
from cdff_common.types.message import Message
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MeshMetadata(Message):
    """What a ``Mesh-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 octets
    frame_id : str, at most 256 octets
        frame of the vertices.
    time_stamp : Time
        end of capture of what it was made from.
    """

    ASN1_NAME: ClassVar[str] = "Mesh-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    frame_id: str = ""
    time_stamp: Time = field(default_factory=Time)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "MeshMetadata.msg_version", 0, 4294967295))
        put(self, "producer_id", check.text(self.producer_id, "MeshMetadata.producer_id", 256))
        put(self, "frame_id", check.text(self.frame_id, "MeshMetadata.frame_id", 256))
        put(self, "time_stamp", check.instance(self.time_stamp, "MeshMetadata.time_stamp", Time))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MeshData(MeshDataExt):
    """What a ``Mesh-Data`` of the ASN.1 modules holds.

    Attributes
    ----------
    vertices : NDArray[np.float64], shape (n, 3)
        m, x y z.
    triangles : NDArray[np.uint32], shape (n, 3)
        numbers of vertices from 0, counter-clockwise seen from outside.
    normals : NDArray[np.float32], shape (n, 3)
        unit length, outwards; none or one for each vertex.
    colors : NDArray[np.uint8], shape (n, 3)
        r g b; none or one for each vertex.
    """

    ASN1_NAME: ClassVar[str] = "Mesh-Data"
    vertices: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    triangles: NDArray[np.uint32] = field(default_factory=lambda: np.zeros((0, 3), np.uint32))
    normals: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    colors: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), np.uint8))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "vertices", check.typed_octets(self.vertices, "MeshData.vertices", 1073741824, "<f8", 3))
        put(self, "triangles", check.typed_octets(self.triangles, "MeshData.triangles", 1073741824, "<u4", 3))
        put(self, "normals", check.typed_octets(self.normals, "MeshData.normals", 1073741824, "<f4", 3))
        put(self, "colors", check.typed_octets(self.colors, "MeshData.colors", 1073741824, "<u1", 3))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Mesh(MeshExt):
    """A surface of triangles in one frame.

    Attributes
    ----------
    metadata : MeshMetadata
    data : MeshData
    """

    ASN1_NAME: ClassVar[str] = "Mesh"
    metadata: MeshMetadata = field(default_factory=MeshMetadata)
    data: MeshData = field(default_factory=MeshData)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "Mesh.metadata", MeshMetadata))
        put(self, "data", check.instance(self.data, "Mesh.data", MeshData))
        self._check_together()
