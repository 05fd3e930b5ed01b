# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faces of PLY files: reading of ascii and binary files of either byte order, writing of binary ones."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cdff_common.arrays import IntArray
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.file_source import Source
from cdff_common.formats.meshes.arrays import MeshArrays, fan
from cdff_common.formats.ply import PLY_BYTE_ORDERS, PlyElement, ply_header, read_ply, write_ply


def read_ply_mesh(s: Source) -> MeshArrays:
    """Read the vertices and faces of a PLY file; the list of a face must be its first property.

    Raises
    ------
    CodecError
        If it has no faces, or is malformed or truncated.
    """
    vertices = read_ply(s).points_m
    layout, elements, start = ply_header(s)
    face = next((e for e in elements if e.name == "face"), None)
    if face is None:
        raise s.error("a point cloud without the element face, expected a mesh")
    if not face.lists or face.lists[0][0] not in ("vertex_indices", "vertex_index"):
        raise s.error("faces without the list vertex_indices")
    before = elements[: elements.index(face)]
    if any(e.has_list for e in before):
        raise s.error("an element with lists precedes the faces")
    if layout == "ascii":
        triangles = _ascii(s, start, sum(e.count for e in before), face)
    else:
        sizes = [sum(np.dtype(kind).itemsize for _, kind in e.properties) * e.count for e in before]
        triangles = _binary(s, start + sum(sizes), face, PLY_BYTE_ORDERS[layout])
    return MeshArrays.checked(vertices, triangles, s.name)


def write_ply_mesh(
    vertices: CloudArrays, triangles: IntArray, *, comments: Mapping[str, str] | None = None
) -> bytes:
    """Return a little-endian PLY file of vertices and triangles ``(m, 3)``; comments as ``name value``."""
    cloud = write_ply(vertices, comments=comments)
    end = cloud.index(b"end_header\n")
    faces = f"element face {len(triangles)}\nproperty list uchar int vertex_indices\n".encode()
    table = np.empty(len(triangles), dtype=[("n", "u1"), ("corners", "<i4", (3,))])
    table["n"], table["corners"] = 3, triangles
    return cloud[:end] + faces + cloud[end:] + table.tobytes()


def _ascii(s: Source, start: int, skip: int, face: PlyElement) -> IntArray:
    """Return the triangles (n, 3) of the faces in a text file, after ``skip`` other lines."""
    lines = s.data[start:].split(b"\n", skip + face.count)[skip : skip + face.count]
    if len(lines) < face.count:
        raise s.error(f"ends after {len(lines)} of {face.count} faces")
    try:
        words = [[int(word) for word in line.split()] for line in lines]
        polygons = [row[1 : row[0] + 1] for row in words]
    except (ValueError, IndexError) as error:
        raise s.error(f"a face is malformed: {error}") from error
    return fan(polygons)


def _binary(s: Source, offset: int, face: PlyElement, order: str) -> IntArray:
    """Return the triangles; files with triangles only are read in one piece."""
    _, count_type, index_type = face.lists[0]
    count, index = np.dtype(order + count_type), np.dtype(order + index_type)
    property_bytes = sum(np.dtype(kind).itemsize for _, kind in face.properties)
    if len(face.lists) > 1 and property_bytes:
        raise s.error("faces with several lists and other properties")
    row = np.dtype([("n", count), ("corners", index, (3,)), ("rest", "u1", (property_bytes,))])
    if len(face.lists) == 1 and offset + face.count * row.itemsize <= len(s.data):
        table = np.frombuffer(s.data, row, face.count, offset)
        if (table["n"] == 3).all():
            return table["corners"].astype(np.int64)
    polygons = []
    for _ in range(face.count):
        for i, (_, count_kind, index_kind) in enumerate(face.lists):
            count, index = np.dtype(order + count_kind), np.dtype(order + index_kind)
            try:
                n = int(np.frombuffer(s.data, count, 1, offset)[0])
                values = np.frombuffer(s.data, index, n, offset + count.itemsize)
            except ValueError as error:
                raise s.error(f"ends within the faces: {error}") from error
            offset += count.itemsize + n * index.itemsize
            if i == 0:
                polygons.append(values.tolist())
        offset += property_bytes
    return fan(polygons)
