# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Points and outward normals of a model, and which of the points a viewer sees from each direction."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.geometry.kdtree import kd_tree, neighbours

#: Number of directions for which the visibility is computed.
DIRECTIONS = 162
#: Pixel size of the visibility test, in voxels; with 2 a surface has no holes.
_PIXEL_VOXELS = 2.0
#: Minimum cosine between normal and direction for the test of a side of the surface.
_FACING = 0.3
#: Mean difference between the visible fractions of both sides above which a surface is closed.
_CLOSED = 0.4
#: Neighbours of a point in the graph along which normals get a common sign.
_NEIGHBOURS = 10
#: Largest number of pixels of a side of the depth image of a model.
_MAX_SIDE = 2000


@dataclass(frozen=True, slots=True, eq=False)
class ModelSurface:
    """Points of a model with normals towards the outside.

    Attributes
    ----------
    points_m, normals : ndarray, shape (n, 3)
        Points in the frame of the model, metres, and unit normals.
    is_closed : bool
        False if both sides of the surface are visible; the common sign of the normals is then arbitrary.
    directions : ndarray, shape (d, 3)
        Unit vectors from the model to the viewer.
    unhidden : ndarray of bool, shape (d, n)
        True if no other point hides the point.
    visible : ndarray of bool, shape (d, n)
        True if the point is unhidden and its normal faces the viewer.
    """

    points_m: FloatArray
    normals: FloatArray
    is_closed: bool
    directions: FloatArray
    unhidden: BoolArray
    visible: BoolArray

    def reversed(self) -> ModelSurface:
        """Return the surface with reversed normals, as seen from its other side."""
        return _oriented_surface(self.points_m, -self.normals, self.unhidden, self.is_closed)

    def subset(self, rows: IntArray) -> ModelSurface:
        """Return the surface with the points ``rows`` (m,) only."""
        return ModelSurface(
            self.points_m[rows],
            self.normals[rows],
            self.is_closed,
            self.directions,
            np.ascontiguousarray(self.unhidden[:, rows]),
            np.ascontiguousarray(self.visible[:, rows]),
        )

    def visible_from(self, viewpoint_m: FloatArray) -> BoolArray:
        """Return a mask (n,) of the points visible from a distant viewpoint (3,) in the model's frame."""
        return np.asarray(self.visible[int(np.argmax(self.directions @ viewpoint_m))])


def model_surface(points_m: FloatArray, normals: FloatArray, voxel_m: float) -> ModelSurface:
    """Return the surface of points ``(n, 3)``, one per voxel, whose normals (n, 3) have arbitrary signs.

    A point of a closed surface is visible only from the side to which its outward normal points. The normals
    of an open surface get a common sign along the minimum spanning tree of neighbours (Hoppe et al. 1992,
    doi:10.1145/133994.134011).
    """
    directions = sphere_directions(DIRECTIONS)
    unhidden = unhidden_points(points_m, directions, _PIXEL_VOXELS * voxel_m)
    cosine = directions @ normals.T
    front, back = (
        np.sum(unhidden & (sign * cosine > _FACING), axis=0)
        / np.maximum(np.sum(sign * cosine > _FACING, axis=0), 1)
        for sign in (1.0, -1.0)
    )
    is_closed = float(np.mean(np.abs(front - back))) > _CLOSED
    if is_closed:
        sign = np.where(front >= back, 1.0, -1.0)
    else:
        _, index = neighbours(kd_tree(points_m), points_m, min(_NEIGHBOURS, len(points_m)))
        sign = consistent_signs(normals, index)
    return _oriented_surface(points_m, normals * sign[:, None], unhidden, is_closed)


def _oriented_surface(
    points_m: FloatArray, normals: FloatArray, unhidden: BoolArray, is_closed: bool
) -> ModelSurface:
    """Return the surface with the visibility that follows from the normals."""
    directions = sphere_directions(DIRECTIONS)
    visible = unhidden & (directions @ normals.T > 0.0)
    return ModelSurface(points_m, normals, is_closed, directions, unhidden, visible)


def sphere_directions(count: int) -> FloatArray:
    """Return unit vectors ``(count, 3)``, evenly distributed by a Fibonacci spiral."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(count)
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


@njit(cache=True)
def unhidden_points(
    points: FloatArray, directions: FloatArray, pixel: float
) -> BoolArray:  # pragma: no cover - compiled
    """Return a mask (d, n) of the points (n, 3) that no other point hides, for each direction (d, 3).

    ``pixel`` is the pixel size in the unit of the points.
    """
    n = len(points)
    out = np.zeros((len(directions), n), np.bool_)
    radius = 0.0
    for i in range(n):
        radius = max(radius, abs(points[i, 0]), abs(points[i, 1]), abs(points[i, 2]))
    pixel = max(pixel, 2.0 * math.sqrt(3.0) * radius / _MAX_SIDE)
    size = int(2.0 * math.sqrt(3.0) * radius / pixel) + 3
    nearest = np.empty(size * size)
    pixels, height = np.empty(n, np.int64), np.empty(n)
    for k in range(len(directions)):
        d = directions[k]
        helper = np.array([1.0, 0.0, 0.0]) if abs(d[0]) < 0.7 else np.array([0.0, 1.0, 0.0])
        u = np.cross(d, helper)
        u /= math.sqrt(u[0] ** 2 + u[1] ** 2 + u[2] ** 2)
        v = np.cross(d, u)
        nearest[:] = -np.inf
        for i in range(n):
            x = u[0] * points[i, 0] + u[1] * points[i, 1] + u[2] * points[i, 2]
            y = v[0] * points[i, 0] + v[1] * points[i, 1] + v[2] * points[i, 2]
            height[i] = d[0] * points[i, 0] + d[1] * points[i, 1] + d[2] * points[i, 2]
            column, row = int(x / pixel + 0.5 * size), int(y / pixel + 0.5 * size)
            pixels[i] = row * size + column
            nearest[pixels[i]] = max(nearest[pixels[i]], height[i])
        for i in range(n):
            out[k, i] = height[i] >= nearest[pixels[i]] - 1.5 * pixel
    return out


@njit(cache=True)
def consistent_signs(normals: FloatArray, index: IntArray) -> FloatArray:  # pragma: no cover - compiled
    """Return signs (n,) that make normals (n, 3) of neighbours ``index`` (n, k) agree (Prim's algorithm)."""
    n, k = index.shape
    sign, best, parent = np.zeros(n), np.full(n, -1.0), np.full(n, -1, np.int64)
    for _ in range(n):
        next_point = -1
        for i in range(n):
            if sign[i] == 0.0 and (next_point < 0 or best[i] > best[next_point]):
                next_point = i
        sign[next_point] = 1.0
        if parent[next_point] >= 0:
            p = parent[next_point]
            dot = (
                normals[p, 0] * normals[next_point, 0]
                + normals[p, 1] * normals[next_point, 1]
                + normals[p, 2] * normals[next_point, 2]
            )
            sign[next_point] = sign[p] if dot >= 0.0 else -sign[p]
        for j in range(k):
            q = index[next_point, j]
            if q < 0 or q >= n or sign[q] != 0.0:
                continue
            dot = abs(
                normals[q, 0] * normals[next_point, 0]
                + normals[q, 1] * normals[next_point, 1]
                + normals[q, 2] * normals[next_point, 2]
            )
            if dot > best[q]:
                best[q], parent[q] = dot, next_point
    return sign
