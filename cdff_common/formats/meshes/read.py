# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reading of a mesh in any supported format, recognised by its content."""

from __future__ import annotations

import struct
from collections.abc import Callable

from cdff_common.formats.file_source import Readable, Source, load
from cdff_common.formats.meshes.arrays import MeshArrays
from cdff_common.formats.meshes.glb import read_glb
from cdff_common.formats.meshes.obj import read_obj
from cdff_common.formats.meshes.ply_faces import read_ply_mesh
from cdff_common.formats.meshes.stl import BINARY_HEADER_BYTES, BINARY_TRIANGLE_BYTES, read_stl
from cdff_common.formats.meshes.vrml import read_vrml

_READERS: dict[str, Callable[[Source], MeshArrays]] = {
    "obj": read_obj,
    "ply": read_ply_mesh,
    "stl": read_stl,
    "glb": read_glb,
    "wrl": read_vrml,
}
MESH_FORMATS = tuple(_READERS)
#: Bytes at the start of a file from which the format is determined.
_HEAD_BYTES = 1 << 16


def detect_mesh(source: Readable) -> str | None:
    """Return the format of a mesh file, one of ``MESH_FORMATS``; None for other files."""
    s = load(source)
    if s.data.startswith((b"ply\n", b"ply\r")):
        return "ply"
    if s.data.startswith(b"glTF"):
        return "glb"
    if s.data.startswith(b"#VRML"):
        return "wrl"
    head = s.data[:_HEAD_BYTES]
    if head.lstrip().startswith(b"solid") and b"facet" in head:
        return "stl"
    if len(s.data) >= BINARY_HEADER_BYTES:
        (count,) = struct.unpack_from("<I", s.data, BINARY_HEADER_BYTES - 4)
        if len(s.data) == BINARY_HEADER_BYTES + BINARY_TRIANGLE_BYTES * count:
            return "stl"
    lines = [line.split(None, 1) for line in head.splitlines()[:2000]]
    keywords = {words[0] for words in lines if words and not words[0].startswith(b"#")}
    is_obj = b"v" in keywords and keywords <= _OBJ_KEYWORDS
    return "obj" if is_obj else None


def read_mesh(source: Readable) -> MeshArrays:
    """Read a mesh; the coordinates stay in the unit of the file.

    Raises
    ------
    CodecError
        If the file is not a mesh, is malformed, or has no triangle.
    InputError
        If the file cannot be read.
    """
    s = load(source)
    fmt = detect_mesh(s)
    if fmt is None:
        raise s.error(f"not recognised as a mesh, expected one of {', '.join(MESH_FORMATS)}")
    return _READERS[fmt](s)


_OBJ_KEYWORDS = frozenset(
    b"v vt vn vp f l p g o s usemtl mtllib mg bevel c_interp d_interp lod maplib usemap".split()
)
