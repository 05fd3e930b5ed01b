# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Triangle meshes of simple solids, of which the built-in models consist; metres, outward normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """Vertices ``(n, 3)`` and triangles ``(m, 3)`` of one material."""

    vertices: FloatArray
    triangles: NDArray[np.int64]
    material: str

    def moved(self, to_m: ArrayLike, rotation_deg: ArrayLike = (0.0, 0.0, 0.0)) -> Shape:
        """Return the shape, rotated about the origin by a rotation vector and then translated."""
        R = se3.exp_so3(np.radians(np.asarray(rotation_deg, dtype=float)))
        return Shape(self.vertices @ np.asarray(R).T + np.asarray(to_m), self.triangles, self.material)

    def without_slivers(self, double_area_m2: float) -> Shape:
        """Return the shape without the triangles whose double area is at most the limit."""
        corners = self.vertices[self.triangles]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        return Shape(self.vertices, self.triangles[area > double_area_m2], self.material)


def box(size_m: ArrayLike, material: str, cells: int = 1) -> Shape:
    """Return a box about the origin; each face has ``cells`` × ``cells`` squares."""
    half = 0.5 * np.asarray(size_m, dtype=float)
    grid = np.linspace(-1.0, 1.0, cells + 1)
    a, b = (g.ravel() for g in np.meshgrid(grid, grid, indexing="ij"))
    n = cells + 1
    corner = (np.arange(cells)[:, None] * n + np.arange(cells)).ravel()
    lower = np.column_stack([corner, corner + n, corner + n + 1])
    upper = np.column_stack([corner, corner + n + 1, corner + 1])
    squares = np.concatenate([lower, upper])
    vertices: list[FloatArray] = []
    triangles: list[NDArray[np.int64]] = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            face = np.empty((n * n, 3))
            face[:, axis] = side
            face[:, (axis + 1) % 3], face[:, (axis + 2) % 3] = a, b
            triangles.append((squares if side > 0.0 else squares[:, ::-1]) + len(vertices) * n * n)
            vertices.append(face)
    return Shape(np.concatenate(vertices) * half, np.concatenate(triangles), material)


def revolution(profile_m: ArrayLike, material: str, segments: int = 32) -> Shape:
    """Return the surface of a profile ``(k, 2)`` of radius and height, rotated about z.

    The profile ascends for outward normals; ends away from the axis stay open.
    """
    profile = np.asarray(profile_m, dtype=float)
    angle = 2.0 * np.pi * np.arange(segments) / segments
    k = len(profile)
    vertices = np.stack(
        [
            np.outer(np.cos(angle), profile[:, 0]),
            np.outer(np.sin(angle), profile[:, 0]),
            np.tile(profile[:, 1], (segments, 1)),
        ],
        axis=2,
    ).reshape(-1, 3)
    column = np.arange(segments)[:, None] * k + np.arange(k - 1)
    following = np.roll(np.arange(segments), -1)[:, None] * k + np.arange(k - 1)
    a, b, c, d = column.ravel(), following.ravel(), (following + 1).ravel(), (column + 1).ravel()
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return Shape(vertices, triangles, material).without_slivers(1e-12)


def cylinder(radius_m: float, length_m: float, material: str, segments: int = 32) -> Shape:
    """Return a closed cylinder along z about the origin."""
    h = 0.5 * length_m
    return revolution([[0.0, -h], [radius_m, -h], [radius_m, h], [0.0, h]], material, segments)


def dish(radius_m: float, depth_m: float, material: str, rings: int = 10, segments: int = 40) -> Shape:
    """Return a parabolic antenna that opens to z; its vertex is the origin. Both sides are surfaces."""
    r = np.linspace(0.0, radius_m, rings)
    inside = np.column_stack([r, depth_m * (r / radius_m) ** 2])
    thickness_m = 0.02 * radius_m
    profile = np.concatenate([inside - [0.0, thickness_m], inside[::-1]])
    return revolution(profile, material, segments)
