# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Flat panels of a known size in a lidar scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from cdff_common.arrays import FloatArray

#: Radius of the neighbourhood of a point, as a part of the shorter side of the panel.
_RADIUS_PART = 0.3
#: Edge of the voxels in which points are thinned, as a part of the shorter side.
_VOXEL_PART = 0.07
#: Largest angle between the normals of neighbours on one panel, cosine, and largest distance of a neighbour
#: from the plane of a point, as a part of the shorter side.
_COS_NORMALS, _OFF_PLANE_PART = np.cos(np.deg2rad(15.0)), 0.08
#: Limits of the extents of a panel, as parts of its sides: the scan lines cut its edges.
_SHORTEST_PART, _LONGEST_PART = 0.6, 1.25
#: Least number of points of a panel.
_LEAST_POINTS = 30
#: Points further from the plane than this number of standard deviations do not belong to it.
_GATE = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """Plane ``normal · p = offset_m`` of a panel in the frame of the lidar.

    Attributes
    ----------
    normal : ndarray, shape (3,)
        Towards the sensor.
    centre_m : ndarray, shape (3,)
        Mean of the points.
    covariance : ndarray, shape (3, 3)
        Of the distance along the normal at the centre (m) and of the slopes along ``axes``.
    axes : ndarray, shape (2, 3)
        Two unit vectors in the plane.
    points : int
    rms_m : float
    """

    normal: FloatArray
    centre_m: FloatArray
    covariance: FloatArray
    axes: FloatArray
    points: int
    rms_m: float


def find_panels(points_m: FloatArray, size_m: tuple[float, float], largest_range_m: float) -> list[Panel]:
    """Return the flat surfaces of the size of a panel in a scan.

    Parameters
    ----------
    points_m : ndarray, shape (n, 3)
        In the frame of the lidar.
    size_m : (float, float)
        Sides of the panel.
    largest_range_m : float
        Points that are further away are left out.
    """
    short_m = min(size_m)
    ranges = np.linalg.norm(points_m, axis=1)
    near = points_m[np.isfinite(ranges) & (ranges > 0.05) & (ranges < largest_range_m)]
    if len(near) < _LEAST_POINTS:
        return []
    cells = np.floor(near / (_VOXEL_PART * short_m)).astype(np.int64)
    thinned = near[np.unique(cells, axis=0, return_index=True)[1]]
    tree = cKDTree(thinned)
    pairs = tree.query_pairs(_RADIUS_PART * short_m, output_type="ndarray")
    normals, is_flat = _normals(thinned, pairs, short_m)
    a, b = pairs.T
    offset = np.abs(np.einsum("ni,ni->n", normals[a], thinned[b] - thinned[a]))
    offset = np.maximum(offset, np.abs(np.einsum("ni,ni->n", normals[b], thinned[b] - thinned[a])))
    is_edge = (np.abs(np.einsum("ni,ni->n", normals[a], normals[b])) > _COS_NORMALS) & is_flat[a] & is_flat[b]
    is_edge &= offset < _OFF_PLANE_PART * short_m
    graph = coo_array((np.ones(int(is_edge.sum())), (a[is_edge], b[is_edge])), shape=(len(thinned),) * 2)
    count, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels, minlength=count)
    panels = []
    for label in np.flatnonzero(sizes >= _LEAST_POINTS // 3):
        panel = _panel(near, thinned[labels == label], size_m)
        if panel is not None:
            panels.append(panel)
    return panels


def _normals(points: FloatArray, pairs: FloatArray, short_m: float) -> tuple[FloatArray, FloatArray]:
    """Return the normals ``(n, 3)`` of the neighbourhoods, and whether these are flat, ``(n,)``."""
    n = len(points)
    ends = np.concatenate([pairs, pairs[:, ::-1], np.column_stack([np.arange(n)] * 2)])
    count = np.bincount(ends[:, 0], minlength=n).astype(np.float64)
    values = points[ends[:, 1]] - points[ends[:, 0]]
    mean = np.column_stack([np.bincount(ends[:, 0], v, minlength=n) for v in values.T]) / count[:, None]
    scatter = np.empty((n, 3, 3))
    for i in range(3):
        for j in range(i, 3):
            second = np.bincount(ends[:, 0], values[:, i] * values[:, j], minlength=n) / count
            scatter[:, i, j] = scatter[:, j, i] = second - mean[:, i] * mean[:, j]
    eigenvalues, vectors = np.linalg.eigh(scatter)
    is_flat = (np.sqrt(np.maximum(eigenvalues[:, 0], 0.0)) < 0.5 * _OFF_PLANE_PART * short_m) & (
        eigenvalues[:, 1] > (0.05 * short_m) ** 2
    )
    return vectors[:, :, 0], is_flat


def _panel(points: FloatArray, seeds: FloatArray, size_m: tuple[float, float]) -> Panel | None:
    """Return the panel around some points of it; None if the surface has another size."""
    centre = seeds.mean(axis=0)
    axes = np.linalg.svd(seeds - centre, full_matrices=False)[2]
    diagonal_m = float(np.hypot(*size_m))
    near = points[np.linalg.norm(points - centre, axis=1) < _LONGEST_PART * diagonal_m]
    sigma_m = max(float(np.std((seeds - centre) @ axes[2])), 1e-3)
    for _ in range(3):
        local = (near - centre) @ axes.T
        inside = np.abs(local[:, 2]) < _GATE * sigma_m
        low, high = ((seeds - centre) @ axes[:2].T).min(axis=0), ((seeds - centre) @ axes[:2].T).max(axis=0)
        slack = 0.02 * diagonal_m
        inside &= ((local[:, :2] > low - slack) & (local[:, :2] < high + slack)).all(axis=1)
        own = near[inside]
        if len(own) < _LEAST_POINTS:
            return None
        centre = own.mean(axis=0)
        axes = np.linalg.svd(own - centre, full_matrices=False)[2]
        sigma_m = max(float(np.std((own - centre) @ axes[2])), 1e-3)
    local = (own - centre) @ axes.T
    extents = np.sort(_rectangle(local[:, :2]))
    sides = np.sort(np.array(size_m))
    if not ((extents > _SHORTEST_PART * sides) & (extents < _LONGEST_PART * sides)).all():
        return None
    normal, plane = axes[2], axes[:2]
    if normal @ centre > 0.0:
        normal = -normal
    design = np.column_stack([np.ones(len(own)), local[:, :2]])
    covariance = np.linalg.inv(design.T @ design) * sigma_m**2
    return Panel(normal, centre, covariance, plane, len(own), sigma_m)


def _rectangle(plane: FloatArray) -> FloatArray:
    """Return the sides of the rectangle of least area around points ``(n, 2)``."""
    import cv2

    return np.asarray(cv2.minAreaRect(np.ascontiguousarray(plane, np.float32))[1], np.float64)
