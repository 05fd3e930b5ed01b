# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wavefront OBJ: vertices and faces; materials, normals and textures are not read."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import IntArray
from cdff_common.formats.file_source import Source
from cdff_common.formats.meshes.arrays import MeshArrays, fan


def read_obj(s: Source) -> MeshArrays:
    """Read an OBJ file; polygons become fans of triangles.

    Raises
    ------
    CodecError
        If a vertex or face is malformed, or there is no face.
    """
    vertices: list[list[bytes]] = []
    corners: list[list[bytes]] = []
    #: Number of vertices before each face, to which negative indices refer.
    known: list[int] = []
    for line in s.data.replace(b"\\\n", b" ").splitlines():
        if line.startswith((b"v ", b"v\t")):
            vertices.append(line.split()[1:4])
        elif line.startswith((b"f ", b"f\t")):
            corners.append([word.split(b"/", 1)[0] for word in line.split()[1:]])
            known.append(len(vertices))
    try:
        v = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise s.error(f"a vertex is not three numbers: {error}") from error
    return MeshArrays.checked(v, _triangles(s, corners, known), s.name)


def _triangles(s: Source, corners: list[list[bytes]], known: list[int]) -> IntArray:
    """Return the triangles (n, 3) of faces; ``known`` is the number of vertices before each face, for
    negative indices.
    """
    try:
        if corners and all(len(words) == 3 for words in corners):
            indices = np.array(corners).astype(np.int64)
            return np.where(indices > 0, indices - 1, indices + np.array(known)[:, None])
        polygons = [
            [int(word) - 1 if int(word) > 0 else n + int(word) for word in words]
            for words, n in zip(corners, known, strict=True)
        ]
    except ValueError as error:
        raise s.error(f"a face is malformed: {error}") from error
    return fan(polygons)
