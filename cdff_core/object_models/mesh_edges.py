# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Edges of a mesh and control points on those that are visible at a pose: outline, creases and borders."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry.small_vectors import inverse_translation, transformed
from cdff_core.object_models.rendering import NO_FACE, Window, body_window, draw

#: Vertices closer than this, relative to the extent of the mesh, are the same vertex.
_SAME_VERTEX = 1e-5
#: Least size of the window in which a mesh is drawn, px.
_MIN_WINDOW = 8
#: A surface hides a control point if it is in front of the point by more than this fraction of the depth of
#: the point.
_HIDDEN = 0.01


class MeshEdges(NamedTuple):
    """Edges between the faces of a mesh.

    Attributes
    ----------
    ends_m : ndarray, shape (e, 2, 3)
        Ends in the frame of the model.
    normals : ndarray, shape (e, 2, 3)
        Unit normals of the two faces; twice the same for the border of a surface.
    is_sharp : ndarray of bool, shape (e,)
        The faces meet at an angle, or there is one face only.
    """

    ends_m: FloatArray
    normals: FloatArray
    is_sharp: np.ndarray


class DrawnBody(NamedTuple):
    """Rendering of a body in a part of an image.

    Attributes
    ----------
    first_pixel : ndarray of int64, shape (2,)
        Column and row of the first pixel of the part.
    window : Window
    inverse_depth : ndarray, shape (rows, columns)
        1/m; 0 where there is no face.
    """

    first_pixel: IntArray
    window: Window
    inverse_depth: FloatArray


def mesh_edges(vertices_m: FloatArray, triangles: IntArray, crease_rad: float) -> MeshEdges:
    """Return the edges of a mesh; those with an angle of at least ``crease_rad`` are sharp."""
    extent = float(np.ptp(vertices_m, axis=0).max())
    cells = np.rint(vertices_m / (_SAME_VERTEX * extent)).astype(np.int64)
    _, first, same = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    vertices, corners = vertices_m[first], same.reshape(-1)[triangles]
    a, b, c = (vertices[corners[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    size = np.linalg.norm(normals, axis=1)
    has_area = size > 0.0
    corners, normals = corners[has_area], normals[has_area] / size[has_area, None]
    pairs = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    faces = np.tile(np.arange(len(corners)), 3)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs, faces = pairs[order], faces[order]
    starts = np.flatnonzero(np.r_[True, (np.diff(pairs, axis=0) != 0).any(axis=1)])
    counts = np.diff(np.r_[starts, len(pairs)])
    edge_normals = normals[np.stack([faces[starts], faces[starts + np.minimum(counts - 1, 1)]], axis=1)]
    cosine = np.einsum("ij,ij->i", edge_normals[:, 0], edge_normals[:, 1])
    is_sharp = (counts != 2) | (cosine < np.cos(crease_rad))
    return MeshEdges(vertices[pairs[starts]], edge_normals, is_sharp)


def visible_edge_points(
    edges: MeshEdges,
    vertices_m: FloatArray,
    triangles: IntArray,
    T_camera_model: FloatArray,
    camera: Window,
    spacing_px: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the control points that are visible in the image of a camera.

    Parameters
    ----------
    edges : MeshEdges
        Those of the mesh.
    vertices_m : ndarray, shape (n, 3)
    triangles : ndarray of int64, shape (m, 3)
    T_camera_model : ndarray, shape (4, 4)
    camera : Window
        The whole image, without lens distortion.
    spacing_px : float
        Distance of the points along an edge.

    Returns
    -------
    points_m, pixels, normals
        As those of ``control_points``, but pixels of the whole image; empty if less than 8 px of the mesh are
        in the image.
    """
    drawn = drawn_body(vertices_m, triangles, T_camera_model, camera)
    if drawn is None:
        return np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 2))
    points_m, pixels, normals = control_points(
        edges, T_camera_model, drawn.window, drawn.inverse_depth, spacing_px
    )
    return points_m, pixels + drawn.first_pixel, normals


def drawn_body(
    vertices_m: FloatArray, triangles: IntArray, T_camera_model: FloatArray, camera: Window
) -> DrawnBody | None:
    """Return the rendering of a mesh (n, 3), (m, 3) at a pose (4, 4) in the part of the image that contains
    it; None if this part has less than 8 rows or columns.
    """
    row, column, window = body_window(vertices_m, T_camera_model, camera)
    if window.rows < _MIN_WINDOW or window.columns < _MIN_WINDOW:
        return None
    inverse_depth = np.zeros((window.rows, window.columns))
    face = np.full((window.rows, window.columns), NO_FACE, np.int64)
    vertices = np.ascontiguousarray(vertices_m, np.float64)
    faces, T = np.ascontiguousarray(triangles, np.int64), np.ascontiguousarray(T_camera_model, np.float64)
    draw(vertices, faces, T, window, inverse_depth, face, np.empty((len(vertices), 3)))
    return DrawnBody(np.array([column, row]), window, inverse_depth)


def control_points(
    edges: MeshEdges, T_camera_model: FloatArray, window: Window, inverse_depth: FloatArray, spacing_px: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the visible control points.

    Parameters
    ----------
    edges : MeshEdges
    T_camera_model : ndarray, shape (4, 4)
        Pose of the mesh in the camera.
    window : Window
        That of ``inverse_depth``, the rendering of the mesh: 0 where there is no face.
    spacing_px : float
        Distance of the points along an edge.

    Returns
    -------
    points_m : ndarray, shape (n, 3)
        In the frame of the model.
    pixels : ndarray, shape (n, 2)
        Column and row in the window.
    normals : ndarray, shape (n, 2)
        Unit normals of the edges in the image.
    """
    rows = _drawn_edges(edges, np.ascontiguousarray(T_camera_model, np.float64))
    if not len(rows):
        return np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 2))
    ends_m = edges.ends_m[rows]
    ends = ends_m @ T_camera_model[:3, :3].T + T_camera_model[:3, 3]
    scale, middle = np.array([window.fx, window.fy]), np.array([window.cx, window.cy])
    image = ends[..., :2] / ends[..., 2:] * scale + middle
    along = image[:, 1] - image[:, 0]
    length = np.linalg.norm(along, axis=1)
    # The points of all edges together are evenly spaced: short edges of a fine mesh fraction them.
    marks = np.cumsum(length) / spacing_px
    number = np.floor(marks) - np.floor(marks - length / spacing_px)
    number = np.minimum(number, 4096).astype(np.int64)
    edge = np.repeat(np.arange(len(length)), number)
    rank = np.arange(len(edge)) - np.repeat(np.cumsum(number) - number, number)
    fraction = (rank + 0.5) / number[edge]
    pixels = image[edge, 0] + fraction[:, None] * along[edge]
    # The point in space that is seen at a fraction of the image of the edge.
    za, zb = ends[edge, 0, 2], ends[edge, 1, 2]
    depth = 1.0 / ((1.0 - fraction) / za + fraction / zb)
    s = (fraction * depth / zb)[:, None]
    points_m = (1.0 - s) * ends_m[edge, 0] + s * ends_m[edge, 1]
    normals = np.stack([-along[edge, 1], along[edge, 0]], axis=1) / length[edge, None]
    visible = _is_visible(pixels, depth, inverse_depth, _HIDDEN)
    return points_m[visible], pixels[visible], normals[visible]


@njit(cache=True)
def _drawn_edges(edges: MeshEdges, T_camera_model: FloatArray) -> IntArray:  # pragma: no cover - compiled
    """Return the rows (m,) of the edges in front of the camera that are sharp or on the outline."""
    largest = 0.0
    for i in range(len(edges.ends_m)):
        for k in range(2):
            p = edges.ends_m[i, k]
            largest = max(largest, transformed(T_camera_model, p[0], p[1], p[2])[2])
    near_depth = 1e-3 * largest
    rows = np.empty(len(edges.ends_m), np.int64)
    count = 0
    if near_depth <= 0.0:
        return rows[:0]
    camera_x, camera_y, camera_z = inverse_translation(T_camera_model)  # in the frame of the model
    for i in range(len(edges.ends_m)):
        p, q = edges.ends_m[i, 0], edges.ends_m[i, 1]
        if not edges.is_sharp[i]:
            n, m = edges.normals[i, 0], edges.normals[i, 1]
            first = n[0] * (p[0] - camera_x) + n[1] * (p[1] - camera_y) + n[2] * (p[2] - camera_z) < 0.0
            second = m[0] * (p[0] - camera_x) + m[1] * (p[1] - camera_y) + m[2] * (p[2] - camera_z) < 0.0
            if first == second:
                continue
        depth = transformed(T_camera_model, p[0], p[1], p[2])[2]
        other = transformed(T_camera_model, q[0], q[1], q[2])[2]
        if depth > near_depth and other > near_depth:
            rows[count] = i
            count += 1
    return rows[:count]


@njit(cache=True)
def _is_visible(
    pixels: FloatArray, depth: FloatArray, inverse_depth: FloatArray, hidden: float
) -> np.ndarray:  # pragma: no cover - compiled
    """Return the mask (n,) of points that a neighbouring pixel does not hide."""
    rows, columns = inverse_depth.shape
    visible = np.zeros(len(pixels), np.bool_)
    for i in range(len(pixels)):
        column, row = int(np.rint(pixels[i, 0])), int(np.rint(pixels[i, 1]))
        if column < 1 or row < 1 or column >= columns - 1 or row >= rows - 1:
            continue
        limit = (1.0 + hidden) / depth[i]
        is_surface, is_seen = False, False
        for r in range(row - 1, row + 2):
            for c in range(column - 1, column + 2):
                is_seen = is_seen or inverse_depth[r, c] <= limit
                is_surface = is_surface or abs(inverse_depth[r, c] * depth[i] - 1.0) <= 2.0 * hidden
        visible[i] = is_seen and is_surface
    return visible
