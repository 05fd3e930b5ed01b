# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Decimation of meshes by vertex clustering with quadric placement.

Lindstrom (2000), "Out-of-core simplification of large polygonal models", doi:10.1145/344779.344912.
"""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray, IntArray

#: Singular values below this fraction of the largest one are ignored: along their directions a vertex stays
#: at the mean of its cluster.
_RANK = 1e-3
#: Steps of the search for the cell size of the clusters.
_ROUNDS = 20
#: Fraction of the largest number of triangles that the search aims at, and that suffices.
_AIM, _ENOUGH = 0.9, 0.8


def decimate(
    vertices_m: FloatArray, triangles: IntArray, max_triangles: int
) -> tuple[FloatArray, IntArray, float]:
    """Return vertices (n, 3), at most ``max_triangles`` triangles (m, 3), and the edge of the clusters.

    A mesh with fewer triangles is returned without its unused vertices and with an edge of 0. The surface
    moves by less than the diagonal of a cluster.
    """
    v, t = _used_vertices(vertices_m, triangles)
    if len(t) <= max_triangles:
        return v, t, 0.0
    extent = float(np.ptp(v, axis=0).max())
    smallest, largest = extent * 1e-5, extent
    best: tuple[FloatArray, IntArray, float] | None = None
    # In each cell that the surface crosses, about two triangles remain.
    normals = np.cross(v[t[:, 1]] - v[t[:, 0]], v[t[:, 2]] - v[t[:, 0]])
    cell = float(np.sqrt(np.linalg.norm(normals, axis=1).sum() / max_triangles))
    for _ in range(_ROUNDS):
        if not smallest < cell < largest:
            cell = float(np.sqrt(smallest * largest))
        cluster = _clusters(v, cell)
        kept_triangles = _kept_triangles(cluster[t])
        if len(kept_triangles) <= max_triangles:
            best, largest = (_nearest_vertices(v, t, cluster, cell), kept_triangles, cell), cell
            if len(kept_triangles) > _ENOUGH * max_triangles:
                break
        else:
            smallest = cell
        cell *= float(np.sqrt(max(len(kept_triangles), 1) / (_AIM * max_triangles)))
    assert best is not None  # one cluster has no triangle
    return best


def decimate_to_cell(
    vertices_m: FloatArray, triangles: IntArray, cell_m: float
) -> tuple[FloatArray, IntArray]:
    """Return vertices (n, 3) and triangles (m, 3) of a mesh with one vertex for each cell of an edge.

    The surface moves by less than the diagonal of a cell; planes remain where they are.
    """
    v, t = _used_vertices(vertices_m, triangles)
    cluster = _clusters(v, cell_m)
    kept_triangles = _kept_triangles(cluster[t])
    return np.ascontiguousarray(_nearest_vertices(v, t, cluster, cell_m)), kept_triangles


def _used_vertices(vertices: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the vertices that triangles use and the triangles with their rows."""
    used_rows, rows = np.unique(triangles, return_inverse=True)
    return np.ascontiguousarray(vertices[used_rows]), np.ascontiguousarray(rows.reshape(-1, 3))


def _clusters(vertices: FloatArray, cell: float) -> IntArray:
    """Return the number of the cluster of each vertex, from 0."""
    cell_indices = np.floor((vertices - vertices.min(axis=0)) / cell).astype(np.int64)
    key = cell_indices @ np.array([1, 1 << 20, 1 << 40])
    return np.unique(key, return_inverse=True)[1].reshape(-1)


def _kept_triangles(t: IntArray) -> IntArray:
    """Return the distinct triangles with three different corners."""
    t = t[(t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 2] != t[:, 0])]
    if not len(t):
        return t
    _, first = np.unique(np.sort(t, axis=1), axis=0, return_index=True)
    return np.ascontiguousarray(t[np.sort(first)])


def _nearest_vertices(v: FloatArray, t: IntArray, cluster: IntArray, cell: float) -> FloatArray:
    """Return the vertex of each cluster that is nearest to the planes of its triangles."""
    count = int(cluster.max()) + 1
    size = np.bincount(cluster, minlength=count)
    mean = np.stack([np.bincount(cluster, v[:, k], count) for k in range(3)], axis=1) / size[:, None]
    n = np.cross(v[t[:, 1]] - v[t[:, 0]], v[t[:, 2]] - v[t[:, 0]])
    A, b = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for corner in range(3):
        rows = cluster[t[:, corner]]
        distance = np.einsum("ij,ij->i", n, v[t[:, 0]] - mean[rows])
        np.add.at(A, rows, n[:, :, None] * n[:, None, :])
        np.add.at(b, rows, n * distance[:, None])
    step = np.einsum("nij,nj->ni", np.linalg.pinv(A, rcond=_RANK, hermitian=True), b)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return np.asarray(mean + step * np.minimum(1.0, cell / np.maximum(length, 1e-300)))
