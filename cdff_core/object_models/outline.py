# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Points on the outline of a body in an image, with the image inside and outside of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from cdff_common.arrays import ByteArray, FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_core.object_models.mesh_edges import MeshEdges, control_points, drawn_body, mesh_edges
from cdff_core.object_models.rendering import Window


class Outline(NamedTuple):
    """Points of the outline of a body.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        In the frame of the model.
    pixels : ndarray, shape (n, 2)
        Column and row in the image.
    normals : ndarray, shape (n, 2)
        Unit normals in the image, away from the body.
    inside_px, outside_px : ndarray, shape (n,)
        Distances along the normal up to which all pixels are of the body, and none are; at most ``reach_px``.
    """

    points: FloatArray
    pixels: FloatArray
    normals: FloatArray
    inside_px: FloatArray
    outside_px: FloatArray


class OutlineEdges:
    """Edges of a mesh that can be on its outline; computed once for the same arrays."""

    def __init__(self) -> None:
        self._mesh: tuple[FloatArray, IntArray] | None = None

    def of(self, vertices: FloatArray, triangles: IntArray) -> MeshEdges:
        """Return the edges; raises InputError without a triangle."""
        if not len(triangles):
            raise InputError(f"{len(vertices)} vertices and no triangle, expected a mesh")
        if self._mesh is None or self._mesh[0] is not vertices or self._mesh[1] is not triangles:
            edges = mesh_edges(vertices, triangles, np.pi)
            self._edges = edges
            self._mesh = vertices, triangles
        return self._edges


def outline(
    edges: MeshEdges,
    vertices: FloatArray,
    triangles: IntArray,
    T_camera_model: FloatArray,
    camera: Window,
    *,
    spacing_px: float,
    reach_px: float,
) -> Outline:
    """Return points on the outline of a mesh, ``spacing_px`` apart."""
    drawn = drawn_body(vertices, triangles, T_camera_model, camera)
    if drawn is None:
        nothing, none = np.zeros((0, 2)), np.zeros(0)
        return Outline(np.zeros((0, 3)), nothing, nothing, none, none)
    inverse_depth = drawn.inverse_depth
    points, pixels, normals = control_points(edges, T_camera_model, drawn.window, inverse_depth, spacing_px)
    inside, outside = _distances(inverse_depth, pixels, normals, reach_px)
    is_outline = (inside > 0.0) & (outside > 0.0)
    return Outline(
        points[is_outline],
        pixels[is_outline] + drawn.first_pixel,
        normals[is_outline],
        inside[is_outline],
        outside[is_outline],
    )


@njit(cache=True)
def _distances(
    inverse_depth: FloatArray, pixels: FloatArray, normals: FloatArray, reach_px: float
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Return the distances along the normals to the first pixel that is not, and that is, of the body.

    The normals are turned away from the body in place.

    Parameters
    ----------
    inverse_depth : ndarray, shape (rows, columns)
        Rendering of the body, 1/m; 0 outside of it.
    pixels, normals : ndarray, shape (n, 2)
        Column and row of points on the edges of the body in this rendering, px, and unit normals.
    reach_px : float
        Largest distance.

    Returns
    -------
    inside, outside : ndarray, shape (n,)
        Pixels; both are 0 for a point that is not on the outline.
    """
    inside, outside = np.zeros(len(pixels)), np.zeros(len(pixels))
    for i in range(len(pixels)):
        first = _is_body(inverse_depth, pixels[i], normals[i], 1.5)
        second = _is_body(inverse_depth, pixels[i], normals[i], -1.5)
        if first == second:
            continue
        if first:
            normals[i] = -normals[i]
        s = 1.5
        while s < reach_px and _is_body(inverse_depth, pixels[i], normals[i], -s):
            s += 1.0
        inside[i] = min(s, reach_px)
        s = 1.5
        while s < reach_px and not _is_body(inverse_depth, pixels[i], normals[i], s):
            s += 1.0
        outside[i] = min(s, reach_px)
    return inside, outside


@njit(cache=True, inline="always")
def _is_body(
    inverse_depth: FloatArray, pixel: FloatArray, normal: FloatArray, s: float
) -> bool:  # pragma: no cover - compiled
    """Return whether the pixel at a distance ``s`` (px) along a normal is of the body.

    ``inverse_depth`` is ``(rows, columns)``; ``pixel`` and ``normal`` are ``(2,)``, column and row.
    """
    c, r = int(np.rint(pixel[0] + s * normal[0])), int(np.rint(pixel[1] + s * normal[1]))
    if c < 0 or r < 0 or c >= inverse_depth.shape[1] or r >= inverse_depth.shape[0]:
        return False
    return bool(inverse_depth[r, c] > 0.0)


def check_channels(image: ByteArray) -> None:
    """Raise InputError unless an image (r, c, d) has one or three channels."""
    if image.shape[2] not in (1, 3):
        raise InputError(f"image {image.shape}: expected one or three channels")


@njit(cache=True, inline="always")
def colour_bin(image: ByteArray, r: int, c: int, bins: int) -> int:  # pragma: no cover - compiled
    """Return the number of the colour of a pixel of an image (r, c, d)."""
    colour = 0
    for channel in range(image.shape[2]):
        colour = colour * bins + (int(image[r, c, channel]) * bins >> 8)
    return colour
