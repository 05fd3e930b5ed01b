# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Image of a body that the Sun illuminates: diffuse reflection with cast shadows."""

from __future__ import annotations

import cv2
import numpy as np

from cdff_common.arrays import Float32Array, FloatArray, IntArray
from cdff_common.geometry import se3
from cdff_core.object_models.rendering import Window, camera_normals, render

#: Side of the image of the body as seen from the Sun, pixels, and distance of the camera of this image,
#: radii of the body.
_SHADOW_PX, _SHADOW_DISTANCE = 384, 200.0
#: Difference in depth to the surface nearest to the Sun above which a point is in shadow, pixels of the
#: image seen from the Sun: on a surface that faces the Sun, and for each unit of the slope to the direction
#: of the Sun, along which the depth changes within the pixel (half of its diagonal), up to a largest slope.
_SHADOW_BIAS_PX, _SLOPE_BIAS_PX, _MAX_SLOPE = 2.0, 0.71, 20.0
#: The image is rendered with one to four pixels per pixel of the window, so that the body has at least this
#: extent, pixels.
_RENDERED_PX = 200.0


def lit_body(
    vertices_m: FloatArray,
    triangles: IntArray,
    T_window_body: FloatArray,
    window: Window,
    sun: FloatArray,
    *,
    point_spread_px: float,
    extent_px: float,
) -> Float32Array:
    """Return the image of a body, relative to a surface that faces the Sun and the camera.

    The reflection follows Lommel and Seeliger: ``2 mu0 / (mu0 + mu)``, with the cosines of the angles from
    the normal of the surface to the Sun and to the camera.

    Parameters
    ----------
    vertices_m : ndarray, shape (v, 3)
        In the frame of the body, metres.
    triangles : ndarray of int, shape (t, 3)
    T_window_body : ndarray, shape (4, 4)
        Pose of the body in the frame of the camera of the window (x right, y down, z forward).
    window : Window
        Camera and size of the image, px.
    sun : ndarray, shape (3,)
        Unit vector to the Sun in the frame of the window.
    point_spread_px : float
        Standard deviation of the image of a point.
    extent_px : float
        Approximate extent of the body in the image, which determines the sampling.

    Returns
    -------
    ndarray of float32, shape (rows, columns)
        0 in shadow and outside of the body.
    """
    k = int(np.clip(np.ceil(_RENDERED_PX / max(extent_px, 1.0)), 1, 4))
    fine = Window(
        window.fx * k,
        window.fy * k,
        (window.cx + 0.5) * k - 0.5,
        (window.cy + 0.5) * k - 0.5,
        window.rows * k,
        window.columns * k,
    )
    image = render(vertices_m, triangles, T_window_body, fine)
    is_visible = image.face >= 0
    light = np.zeros(image.face.shape, np.float32)
    if is_visible.any():
        normals = camera_normals(vertices_m, triangles, T_window_body, image.face)[is_visible]
        row, column = np.nonzero(is_visible)
        depth = image.depth_m[is_visible]
        points = np.column_stack(
            [(column - fine.cx) / fine.fx * depth, (row - fine.cy) / fine.fy * depth, depth]
        )
        to_camera = -points / np.linalg.norm(points, axis=1, keepdims=True)
        mu0, mu = normals @ sun, np.maximum(np.einsum("ni,ni->n", normals, to_camera), 1e-3)
        lit = np.where(mu0 > 0.0, 2.0 * mu0 / (np.maximum(mu0, 1e-6) + mu), 0.0)
        R, t = T_window_body[:3, :3], T_window_body[:3, 3]
        slopes = np.sqrt(np.maximum(1.0 - mu0**2, 0.0)) / np.maximum(mu0, 1e-6)
        lit[in_shadow(vertices_m, triangles, (points - t) @ R, slopes, R.T @ sun)] = 0.0
        light[is_visible] = lit
    reduced = cv2.resize(light, (window.columns, window.rows), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(reduced, (0, 0), point_spread_px), np.float32)


def in_shadow(
    vertices_m: FloatArray, triangles: IntArray, points_m: FloatArray, slopes: FloatArray, sun: FloatArray
) -> np.ndarray:
    """Return which points of the surface the body hides from the Sun, by a z-buffer seen from the Sun.

    Parameters
    ----------
    vertices_m : ndarray, shape (v, 3)
        In the frame of the body, metres, like ``points_m`` and ``sun``.
    triangles : ndarray of int, shape (t, 3)
    points_m : ndarray, shape (n, 3)
    slopes : ndarray, shape (n,)
        Tangents of the angles from the normals at the points to the Sun.
    sun : ndarray, shape (3,)
        Vector to the Sun, of any length above 0.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    low, high = vertices_m.min(axis=0), vertices_m.max(axis=0)
    centre, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    z = -sun / np.linalg.norm(sun)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    distance = _SHADOW_DISTANCE * radius
    T = se3.transform(R, np.array([0.0, 0.0, distance]) - R @ centre)
    focal, middle = 0.48 * _SHADOW_PX * _SHADOW_DISTANCE, 0.5 * (_SHADOW_PX - 1)
    window = Window(focal, focal, middle, middle, _SHADOW_PX, _SHADOW_PX)
    depth = render(vertices_m, triangles, T, window).depth_m
    p = points_m @ R.T + T[:3, 3]
    column = np.clip(np.rint(focal * p[:, 0] / p[:, 2] + middle), 0, _SHADOW_PX - 1).astype(np.intp)
    row = np.clip(np.rint(focal * p[:, 1] / p[:, 2] + middle), 0, _SHADOW_PX - 1).astype(np.intp)
    limit_px = _SHADOW_BIAS_PX + _SLOPE_BIAS_PX * np.minimum(slopes, _MAX_SLOPE)
    return np.asarray(p[:, 2] > depth[row, column] + limit_px * distance / focal)
