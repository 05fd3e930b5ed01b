# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""STL, binary and ascii; equal corners become one vertex."""

from __future__ import annotations

import struct

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.formats.file_source import Source
from cdff_common.formats.meshes.arrays import MeshArrays

#: 80 bytes of text and the number of triangles; 12 floats and an attribute for each triangle.
BINARY_HEADER_BYTES, BINARY_TRIANGLE_BYTES = 84, 50
_TRIANGLE = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(s: Source) -> MeshArrays:
    """Read an STL file; the stored normals are not read.

    Raises
    ------
    CodecError
        If it is truncated, malformed, or has no triangle.
    """
    corners = _binary(s) if _is_binary(s) else _ascii(s)
    vertices, rows = np.unique(corners, axis=0, return_inverse=True)
    return MeshArrays.checked(vertices, rows.reshape(-1, 3), s.name)


def _is_binary(s: Source) -> bool:
    """Return whether a file is binary: its size is that of its number of triangles, or it does not start
    with solid.
    """
    if len(s.data) < BINARY_HEADER_BYTES:
        return False
    (count,) = struct.unpack_from("<I", s.data, BINARY_HEADER_BYTES - 4)
    size = BINARY_HEADER_BYTES + BINARY_TRIANGLE_BYTES * count
    return len(s.data) == size or not s.data.lstrip().startswith(b"solid")


def _binary(s: Source) -> FloatArray:
    (count,) = struct.unpack_from("<I", s.data, BINARY_HEADER_BYTES - 4)
    size = BINARY_HEADER_BYTES + BINARY_TRIANGLE_BYTES * count
    if len(s.data) < size:
        raise s.error(f"ends after {len(s.data)} bytes, expected {size} for {count} triangles")
    table = np.frombuffer(s.data, _TRIANGLE, count, BINARY_HEADER_BYTES)
    return table["corners"].astype(np.float64).reshape(-1, 3)


def _ascii(s: Source) -> FloatArray:
    """Return the corners (3 n, 3) of the triangles of a text file."""
    rows = [line.split()[1:4] for line in s.data.splitlines() if line.split()[:1] == [b"vertex"]]
    try:
        corners = np.array(rows, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise s.error(f"a vertex is not three numbers: {error}") from error
    if len(corners) % 3:
        raise s.error(f"{len(corners)} corners, expected a multiple of 3")
    return corners
