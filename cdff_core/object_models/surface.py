# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visible surface of a mesh: points with outward normals, and the faces that are seen from outside.

CAD models contain inner parts, double walls and inverted faces. Only what cameras around the model see is
kept, and the normals point towards the cameras, whatever the order of the corners of a face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import DegenerateGeometryError
from cdff_core.object_models.rendering import NO_FACE, camera_normals, render
from cdff_core.object_models.views import directions, view_poses, view_window

#: Pixels of a view that become points.
_POINTS_PER_VIEW = 6000
#: Rounds of the search for the cell size that leaves the wanted number of points.
_ROUNDS = 12


@dataclass(frozen=True, slots=True, eq=False)
class VisibleSurface:
    """Surface of a model as seen from outside, in the frame and unit of the mesh.

    Attributes
    ----------
    points_m, normals : ndarray, shape (n, 3)
        Evenly spread points and their outward unit normals. A thin wall has points on both sides.
    triangles : ndarray of int64, shape (m, 3)
        Triangles seen in at least one view.
    view_directions, view_centroids_m : ndarray, shape (v, 3)
        Directions from the model to the viewers, and the mean of the points that each of them sees.
    centre_m : ndarray, shape (3,)
        Centre of the box around the visible points.
    diameter_m : float
        Largest extent of the visible points in any of the directions.
    """

    points_m: FloatArray
    normals: FloatArray
    triangles: IntArray
    view_directions: FloatArray
    view_centroids_m: FloatArray
    centre_m: FloatArray
    diameter_m: float


def visible_surface(
    vertices_m: FloatArray, triangles: IntArray, *, points: int, views: int, pixels: int, seed: int = 0
) -> VisibleSurface:
    """Return the surface that is visible from ``views`` directions.

    Parameters
    ----------
    vertices_m : ndarray, shape (n, 3)
    triangles : ndarray of int64, shape (m, 3)
    points : int
        Approximate number of points of the result.
    views, pixels : int
        Number of views, and of the pixels of a side of each.
    seed : int
        Seed of the choice of the points.

    Raises
    ------
    DegenerateGeometryError
        If the mesh has no extent.
    """
    used_vertices = vertices_m[np.unique(triangles)]
    low, high = used_vertices.min(axis=0), used_vertices.max(axis=0)
    centre_m, radius_m = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    if radius_m <= 0.0:
        raise DegenerateGeometryError("mesh: all vertices are equal, expected a body with an extent")
    window, rng = view_window(pixels), np.random.default_rng(seed)
    is_visible = np.zeros(len(triangles), bool)
    pool, pool_normals, centroids = [], [], []
    for T in view_poses(centre_m, radius_m, views):
        depth_m, face = render(vertices_m, triangles, T, window)
        rows, columns = np.nonzero(face != NO_FACE)
        is_visible[face[rows, columns]] = True
        if not len(rows):
            centroids.append(centre_m)
            continue
        z = depth_m[rows, columns]
        in_camera = np.stack(
            [(columns - window.cx) * z / window.fx, (rows - window.cy) * z / window.fy, z], axis=1
        )
        in_model = (in_camera - T[:3, 3]) @ T[:3, :3]
        centroids.append(in_model.mean(axis=0))
        sampled_rows = rng.permutation(len(rows))[:_POINTS_PER_VIEW]
        normals = camera_normals(
            vertices_m, triangles, T, face[rows[sampled_rows], columns[sampled_rows]][:, None]
        )[:, 0]
        pool.append(in_model[sampled_rows])
        pool_normals.append(normals @ T[:3, :3])
    if not pool:
        raise DegenerateGeometryError("mesh: no view shows a face, expected a body with an area")
    candidates, candidate_normals = np.concatenate(pool), np.concatenate(pool_normals)
    order = rng.permutation(len(candidates))
    rows = order[_even_rows(candidates[order], candidate_normals[order], points, radius_m)]
    surface, axes = candidates[rows], directions(views)
    extents = np.ptp(surface @ axes.T, axis=0)
    return VisibleSurface(
        surface,
        candidate_normals[rows],
        np.ascontiguousarray(triangles[is_visible]),
        axes,
        np.array(centroids),
        0.5 * (surface.min(axis=0) + surface.max(axis=0)),
        float(extents.max()),
    )


def _even_rows(points: FloatArray, normals: FloatArray, count: int, radius_m: float) -> IntArray:
    """Return the rows of about ``count`` evenly spread points: the first one of each cell and side."""
    axis = np.abs(normals).argmax(axis=1)
    side = 2 * axis + (normals[np.arange(len(normals)), axis] > 0.0)
    low = points.min(axis=0)
    smallest, largest = 1e-4 * radius_m, radius_m
    rows = np.arange(len(points))
    for _ in range(_ROUNDS):
        cell = float(np.sqrt(smallest * largest))
        key = np.floor((points - low) / cell).astype(np.int64) @ np.array([1, 1 << 20, 1 << 40]) * 6 + side
        rows = np.unique(key, return_index=True)[1]
        if len(rows) > count:
            smallest = cell
        else:
            largest = cell
        if abs(len(rows) - count) < 0.01 * count:
            break
    return np.sort(rows)
