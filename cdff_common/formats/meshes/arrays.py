# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Vertices and triangles of a mesh file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import CodecError

#: Metres of the units in which a mesh file can be.
UNITS = {"m": 1.0, "mm": 0.001, "cm": 0.01, "km": 1000.0}


@dataclass(frozen=True, slots=True, eq=False)
class MeshArrays:
    """Triangle mesh.

    Attributes
    ----------
    vertices : ndarray of float64, shape (n, 3)
        In the unit of the file, or metres.
    triangles : ndarray of int64, shape (m, 3)
        Rows of vertices.
    """

    vertices: FloatArray
    triangles: IntArray

    @classmethod
    def checked(cls, vertices: FloatArray, triangles: IntArray, name: str) -> MeshArrays:
        """Return a mesh with valid triangles only.

        Triangles with two equal corners are removed, since exporters write them for seams.

        Parameters
        ----------
        name : str
            Name of the file, for messages.

        Raises
        ------
        CodecError
            If there is no triangle, a triangle has a vertex that does not exist, or a used vertex is not
            finite.
        """
        v = np.ascontiguousarray(vertices, np.float64).reshape(-1, 3)
        t = np.ascontiguousarray(triangles, np.int64).reshape(-1, 3)
        if t.size and (t.min() < 0 or t.max() >= len(v)):
            wrong = int(t.min()) if t.min() < 0 else int(t.max())
            raise CodecError(f"{name}: a face has the vertex {wrong}, expected 0 to {len(v) - 1}")
        t = t[(t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 2] != t[:, 0])]
        if not len(t):
            raise CodecError(f"{name}: a mesh with {len(v)} vertices and no face, expected triangles")
        if not np.isfinite(v[t]).all():
            raise CodecError(f"{name}: a face has a vertex with NaN or infinity, expected finite coordinates")
        return cls(v, t)

    def scaled(self, factor: float) -> MeshArrays:
        """Return the mesh with coordinates multiplied by ``factor``."""
        return self if factor == 1.0 else MeshArrays(self.vertices * factor, self.triangles)


def fan(polygons: list[list[int]]) -> IntArray:
    """Return the triangles (m, 3) of convex polygons, each a list of at least 3 vertices."""
    rows = [(p[0], p[i], p[i + 1]) for p in polygons for i in range(1, len(p) - 1)]
    return np.array(rows, np.int64).reshape(-1, 3)
