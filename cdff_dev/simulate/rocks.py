# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated rocks: convex faceted meshes, partly in the ground, with power-law sizes, none on the paths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cdff_common.geometry.se3 import FloatArray, exp_so3
from cdff_dev.simulate.relief import Relief, power_law_sizes
from cdff_dev.simulate.scenario import Boulder, Plain, Rocks


@dataclass(frozen=True, slots=True, eq=False)
class RockMesh:
    """All rocks as one mesh.

    Attributes
    ----------
    vertices : NDArray[np.float32], shape (n, 3)
        In site, metres.
    triangles : NDArray[np.uint32], shape (m, 3)
    albedo : NDArray[np.float32], shape (n,)
        Albedo of each vertex, relative to the mean of the ground.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    albedo: np.ndarray


def icosphere(levels: int) -> tuple[FloatArray, np.ndarray]:
    """Return the vertices ``(n, 3)`` on the unit sphere and the triangles ``(m, 3)`` of an icosphere.

    The faces of an icosahedron are split into four, ``levels`` times.
    """
    g = (1 + 5**0.5) / 2
    v = np.array(
        [
            [-1, g, 0],
            [1, g, 0],
            [-1, -g, 0],
            [1, -g, 0],
            [0, -1, g],
            [0, 1, g],
            [0, -1, -g],
            [0, 1, -g],
            [g, 0, -1],
            [g, 0, 1],
            [-g, 0, -1],
            [-g, 0, 1],
        ]
    )
    f = np.array(
        [
            [0, 11, 5],
            [0, 5, 1],
            [0, 1, 7],
            [0, 7, 10],
            [0, 10, 11],
            [1, 5, 9],
            [5, 11, 4],
            [11, 10, 2],
            [10, 7, 6],
            [7, 1, 8],
            [3, 9, 4],
            [3, 4, 2],
            [3, 2, 6],
            [3, 6, 8],
            [3, 8, 9],
            [4, 9, 5],
            [2, 4, 11],
            [6, 2, 10],
            [8, 6, 7],
            [9, 8, 1],
        ]
    )
    for _ in range(levels):
        edges = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        middle = len(v) + inverse.reshape(3, -1)
        v = np.concatenate([v, 0.5 * (v[unique[:, 0]] + v[unique[:, 1]])])
        a, b, c = f.T
        ab, bc, ca = middle
        f = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    return v / np.linalg.norm(v, axis=1, keepdims=True), f.astype(np.uint32)


def _one_rock(rng: np.random.Generator, directions: FloatArray, diameter_m: float) -> FloatArray:
    """Return the vertices ``(n, 3)`` of a rock around the origin, metres, in the given directions."""
    # A sphere cut by random planes has facets and edges like impact ejecta.
    normals = rng.standard_normal((14, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = rng.uniform(0.62, 0.95, 14)
    along = directions @ normals.T
    radius = np.min(np.where(along > 1e-3, offsets / np.maximum(along, 1e-3), 1.0), axis=1).clip(max=1.0)
    radius *= 1.0 + 0.03 * rng.standard_normal(len(directions))
    axes = np.array([1.0, rng.uniform(0.65, 1.0), rng.uniform(0.45, 0.85)])
    rotated: FloatArray = (directions * radius[:, None] * axes) @ exp_so3(rng.normal(0, [0.25, 0.25, 2.0])).T
    return rotated * 0.5 * diameter_m


def make_rocks(
    model: Rocks,
    relief: Relief,
    tracks_xy_m: FloatArray,
    rng: np.random.Generator,
    plains: Sequence[Plain] = (),
) -> RockMesh:
    """Return rocks at random positions on the terrain, none on plains.

    Parameters
    ----------
    tracks_xy_m : NDArray[np.float64], shape (n, 2)
        Points along the paths of the rovers; rocks keep ``track_clearance_m`` from them.
    """
    tiny, small, large = icosphere(1), icosphere(2), icosphere(3)
    tree = cKDTree(tracks_xy_m)
    vertices: list[np.ndarray] = []
    triangles: list[np.ndarray] = []
    albedo: list[np.ndarray] = []
    vertex_count = 0
    for diameter in power_law_sizes(
        rng, model.count, model.diameter_min_m, model.diameter_max_m, model.slope
    ):
        xy = rng.uniform(-model.half_width_m, model.half_width_m, 2)
        directions, faces = large if diameter > 0.3 else small if diameter > 0.12 else tiny
        points = _one_rock(rng, directions, float(diameter))
        mean_albedo = float(np.clip(rng.normal(0.92, 0.16), 0.5, 1.35))
        spots = rng.normal(0, 0.05, len(points))
        if tree.query(xy)[0] < model.track_clearance_m + 0.5 * diameter:
            continue
        if any(np.hypot(*(xy - plain.centre_xy_m)) < plain.radius_m for plain in plains):
            continue
        sink_m = rng.uniform(-0.05, 0.2) * diameter
        points += np.array([xy[0], xy[1], relief.height(xy[None])[0] + 0.15 * diameter - sink_m])
        vertices.append(points.astype(np.float32))
        triangles.append(faces + np.uint32(vertex_count))
        albedo.append((mean_albedo + spots).astype(np.float32))
        vertex_count += len(points)
    if not vertices:
        return RockMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint32), np.zeros(0, np.float32))
    return RockMesh(np.concatenate(vertices), np.concatenate(triangles), np.concatenate(albedo))


def with_boulders(
    rocks: RockMesh, boulders: Sequence[Boulder], relief: Relief, rng: np.random.Generator
) -> RockMesh:
    """Return rocks and, in addition, those at given places, partly in the ground."""
    directions, faces = icosphere(3)
    vertices, triangles, albedo = [rocks.vertices], [rocks.triangles], [rocks.albedo]
    count = len(rocks.vertices)
    for boulder in boulders:
        points = _one_rock(rng, directions, boulder.diameter_m)
        xy = np.array([boulder.centre_xy_m])
        points += np.array([*xy[0], relief.height(xy)[0] + 0.25 * boulder.diameter_m])
        vertices.append(points.astype(np.float32))
        triangles.append(faces + np.uint32(count))
        spots = rng.normal(0, 0.05, len(points))
        albedo.append((boulder.albedo + spots).astype(np.float32))
        count += len(points)
    return RockMesh(np.concatenate(vertices), np.concatenate(triangles), np.concatenate(albedo))
