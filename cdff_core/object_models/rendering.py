# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Z-buffer renderer of triangle meshes in a window of a pinhole image.

The image can be that of a camera or a window on the directions of a lidar. Pixel centres have integer
coordinates: column = fx x / z + cx, row = fy y / z + cy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry.small_vectors import transformed

#: Face index of a pixel without a face.
NO_FACE = -1
#: Smallest depth of a visible point, in units of the largest depth of the mesh.
_NEAR = 1e-3


class Window(NamedTuple):
    """Pinhole projection of a window of pixels.

    Attributes
    ----------
    fx, fy, cx, cy : float
        Focal lengths and principal point, pixels; (0, 0) is the centre of the first pixel of the window.
    rows, columns : int
    """

    fx: float
    fy: float
    cx: float
    cy: float
    rows: int
    columns: int

    def cropped(self, row: int, column: int, rows: int, columns: int) -> Window:
        """Return the window of the pixels from (row, column) on."""
        return Window(self.fx, self.fy, self.cx - column, self.cy - row, rows, columns)


class Rendering(NamedTuple):
    """Image of a mesh.

    Attributes
    ----------
    depth_m : ndarray, shape (rows, columns)
        Depth along the optical axis, in the unit of the mesh; infinite where there is no face.
    face : ndarray of int64, shape (rows, columns)
        Visible triangle, ``NO_FACE`` where there is none.
    """

    depth_m: FloatArray
    face: IntArray


def render(
    vertices_m: FloatArray, triangles: IntArray, T_camera_model: FloatArray, window: Window
) -> Rendering:
    """Return depth and visible face of a mesh at a pose.

    Both sides of a triangle are visible. Triangles that cross the plane of the camera are clipped.

    Parameters
    ----------
    vertices_m : ndarray, shape (n, 3)
        Vertices in the frame of the model.
    triangles : ndarray of int64, shape (m, 3)
    T_camera_model : ndarray, shape (4, 4)
        Camera: x right, y down, z forward.
    window : Window
    """
    inverse_depth = np.zeros((window.rows, window.columns))
    face = np.full((window.rows, window.columns), NO_FACE, np.int64)
    draw(
        np.ascontiguousarray(vertices_m, np.float64),
        np.ascontiguousarray(triangles, np.int64),
        np.ascontiguousarray(T_camera_model, np.float64),
        window,
        inverse_depth,
        face,
        np.empty((len(vertices_m), 3)),
    )
    with np.errstate(divide="ignore"):
        return Rendering(1.0 / inverse_depth, face)


def camera_normals(
    vertices_m: FloatArray, triangles: IntArray, T_camera_model: FloatArray, face: IntArray
) -> FloatArray:
    """Return the unit normals (rows, columns, 3) of a rendering, towards the camera; NaN without a face."""
    a, b, c = (vertices_m[triangles[:, i]] @ T_camera_model[:3, :3].T for i in range(3))
    n = np.cross(b - a, c - a)
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-300)
    towards = np.einsum("ij,ij->i", n, a + T_camera_model[:3, 3]) > 0.0
    n[towards] *= -1.0
    return np.where(face[..., None] >= 0, n[face], np.nan)


def body_window(
    vertices_m: FloatArray, T_camera_model: FloatArray, camera: Window
) -> tuple[int, int, Window]:
    """Return the part of the image that contains a body: its first row and column, and its camera.

    Parameters
    ----------
    vertices_m : NDArray[np.float64], shape (n, 3)
        Vertices of the body in its own frame, metres.
    T_camera_model : NDArray[np.float64], shape (4, 4)
        Pose of the body in the camera, metres.
    camera : Window
        Camera of the whole image, pixels.
    """
    points = vertices_m @ T_camera_model[:3, :3].T + T_camera_model[:3, 3]
    z = points[:, 2]
    if (z <= 1e-3 * max(float(z.max()), 0.0)).any():
        # A part is next to or behind the camera: the body may be anywhere in the image.
        return 0, 0, camera if z.max() > 0.0 else camera.cropped(0, 0, 0, 0)
    u, v = camera.fx * points[:, 0] / z + camera.cx, camera.fy * points[:, 1] / z + camera.cy
    low_c, high_c = np.clip([np.floor(u.min()) - 2, np.ceil(u.max()) + 3], 0, camera.columns).astype(int)
    low_r, high_r = np.clip([np.floor(v.min()) - 2, np.ceil(v.max()) + 3], 0, camera.rows).astype(int)
    return int(low_r), int(low_c), camera.cropped(low_r, low_c, int(high_r - low_r), int(high_c - low_c))


def silhouette_pixels(
    vertices_m: FloatArray, triangles: IntArray, T_camera_model: FloatArray, camera: Window, largest: int = 64
) -> float:
    """Return the area of a mesh in an image, px, from a rendering of ``largest`` pixels."""
    _, _, window = body_window(vertices_m, T_camera_model, camera)
    scale = max(1.0, max(window.rows, window.columns) / largest)
    rows, columns = int(camera.rows / scale), int(camera.columns / scale)
    small = Window(camera.fx / scale, camera.fy / scale, camera.cx / scale, camera.cy / scale, rows, columns)
    _, _, window = body_window(vertices_m, T_camera_model, small)
    if window.rows < 1 or window.columns < 1:
        return 0.0
    face = render(vertices_m, triangles, T_camera_model, window).face
    return scale**2 * float(np.count_nonzero(face != NO_FACE))


@njit(cache=True)
def draw(
    vertices: FloatArray,
    triangles: IntArray,
    T_camera_model: FloatArray,
    w: Window,
    inverse_depth: FloatArray,
    face: IntArray,
    scratch: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Draw a mesh into ``inverse_depth`` (0: nothing) and ``face``; ``scratch`` is (n, 3)."""
    largest = 0.0
    for i in range(len(vertices)):
        x, y, z = transformed(T_camera_model, vertices[i, 0], vertices[i, 1], vertices[i, 2])
        scratch[i, 0], scratch[i, 1], scratch[i, 2] = x, y, z
        largest = max(largest, scratch[i, 2])
    near_depth = _NEAR * largest
    if near_depth <= 0.0:
        return
    clipped = np.empty((4, 3))
    for f in range(len(triangles)):
        a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        za, zb, zc = scratch[a, 2], scratch[b, 2], scratch[c, 2]
        if za > near_depth and zb > near_depth and zc > near_depth:
            _triangle(scratch[a], scratch[b], scratch[c], f, w, inverse_depth, face)
        elif za > near_depth or zb > near_depth or zc > near_depth:
            n = _clip(scratch, triangles[f], near_depth, clipped)
            for i in range(1, n - 1):
                _triangle(clipped[0], clipped[i], clipped[i + 1], f, w, inverse_depth, face)


@njit(cache=True)
def _clip(
    points: FloatArray, corners: IntArray, near: float, out: FloatArray
) -> int:  # pragma: no cover - compiled
    """Write the part of a triangle in front of z = near to ``out`` (4, 3); return its number of corners."""
    n = 0
    for i in range(3):
        p, q = points[corners[i]], points[corners[(i + 1) % 3]]
        if p[2] > near:
            out[n] = p
            n += 1
        if (p[2] > near) != (q[2] > near):
            s = (near - p[2]) / (q[2] - p[2])
            for k in range(3):
                out[n, k] = p[k] + s * (q[k] - p[k])
            n += 1
    return n


@njit(cache=True, inline="always")
def _triangle(
    p: FloatArray,
    q: FloatArray,
    r: FloatArray,
    f: int,
    w: Window,
    inverse_depth: FloatArray,
    face: IntArray,
) -> None:  # pragma: no cover - compiled
    """Draw one triangle; the inverse depth is linear in the image, and edges belong to the triangle."""
    ia, ib, ic = 1.0 / p[2], 1.0 / q[2], 1.0 / r[2]
    ax, ay = w.fx * p[0] * ia + w.cx, w.fy * p[1] * ia + w.cy
    bx, by = w.fx * q[0] * ib + w.cx, w.fy * q[1] * ib + w.cy
    cx, cy = w.fx * r[0] * ic + w.cx, w.fy * r[1] * ic + w.cy
    low_x, high_x = min(ax, bx, cx), max(ax, bx, cx)
    low_y, high_y = min(ay, by, cy), max(ay, by, cy)
    if high_x < 0.0 or high_y < 0.0 or low_x > w.columns - 1 or low_y > w.rows - 1:
        return
    first_column, last_column = int(max(np.ceil(low_x), 0.0)), int(min(np.floor(high_x), w.columns - 1.0))
    first_row, last_row = int(max(np.ceil(low_y), 0.0)), int(min(np.floor(high_y), w.rows - 1.0))
    if first_column > last_column or first_row > last_row:
        return
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area == 0.0:
        return
    s = 1.0 / area
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            wb = ((column - ax) * (cy - ay) - (row - ay) * (cx - ax)) * s
            wc = ((bx - ax) * (row - ay) - (by - ay) * (column - ax)) * s
            wa = 1.0 - wb - wc
            if wa < -1e-12 or wb < -1e-12 or wc < -1e-12:
                continue
            value = wa * ia + wb * ib + wc * ic
            if value > inverse_depth[row, column]:
                inverse_depth[row, column] = value
                face[row, column] = f
