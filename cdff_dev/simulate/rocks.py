# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rocks: convex, faceted meshes half sunk in the ground, sizes by a power law, none where a wheel passes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cdff_common.geometry.se3 import FloatArray, exp_so3
from cdff_dev.simulate.relief import Relief, power_law_sizes
from cdff_dev.simulate.scenario import Plain, Rocks


@dataclass(frozen=True, slots=True, eq=False)
class RockMesh:
    """All rocks as one mesh.

    Attributes
    ----------
    vertices : NDArray[np.float32], shape (n, 3)
        In site, metres.
    triangles : NDArray[np.uint32], shape (m, 3)
    albedo : NDArray[np.float32], shape (n,)
        Of each vertex, relative to the ground's mean.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    albedo: np.ndarray


def icosphere(levels: int) -> tuple[FloatArray, np.ndarray]:
    """Unit directions ``(n, 3)`` and triangles ``(m, 3)`` of an icosahedron whose faces are split ``levels``
    times.
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
    # A ball cut by random planes: angular, as impact ejecta are.
    normals = rng.standard_normal((14, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = rng.uniform(0.62, 0.95, 14)
    along = directions @ normals.T
    radius = np.min(np.where(along > 1e-3, offsets / np.maximum(along, 1e-3), 1.0), axis=1).clip(max=1.0)
    radius *= 1.0 + 0.03 * rng.standard_normal(len(directions))
    axes = np.array([1.0, rng.uniform(0.65, 1.0), rng.uniform(0.45, 0.85)])
    turned: FloatArray = (directions * radius[:, None] * axes) @ exp_so3(rng.normal(0, [0.25, 0.25, 2.0])).T
    return turned * 0.5 * diameter_m


def make_rocks(
    model: Rocks,
    relief: Relief,
    tracks_xy_m: FloatArray,
    rng: np.random.Generator,
    plains: Sequence[Plain] = (),
) -> RockMesh:
    """Scatter rocks on the ground, none on plains.

    Parameters
    ----------
    tracks_xy_m : NDArray[np.float64], shape (n, 2)
        Points along the rovers' paths; a rock's edge stays ``track_clearance_m`` away from them.
    """
    tiny, small, large = icosphere(1), icosphere(2), icosphere(3)
    tree = cKDTree(tracks_xy_m)
    vertices: list[np.ndarray] = []
    triangles: list[np.ndarray] = []
    albedo: list[np.ndarray] = []
    total = 0
    for diameter in power_law_sizes(
        rng, model.count, model.diameter_min_m, model.diameter_max_m, model.slope
    ):
        xy = rng.uniform(-model.half_width_m, model.half_width_m, 2)
        directions, faces = large if diameter > 0.3 else small if diameter > 0.12 else tiny
        points = _one_rock(rng, directions, float(diameter))
        tone = float(np.clip(rng.normal(0.92, 0.16), 0.5, 1.35))
        spots = rng.normal(0, 0.05, len(points))
        if tree.query(xy)[0] < model.track_clearance_m + 0.5 * diameter:
            continue
        if any(np.hypot(*(xy - plain.centre_xy_m)) < plain.radius_m for plain in plains):
            continue
        sink = rng.uniform(-0.05, 0.2) * diameter
        points += np.array([xy[0], xy[1], relief.height(xy[None])[0] + 0.15 * diameter - sink])
        vertices.append(points.astype(np.float32))
        triangles.append(faces + np.uint32(total))
        albedo.append((tone + spots).astype(np.float32))
        total += len(points)
    if not vertices:
        return RockMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint32), np.zeros(0, np.float32))
    return RockMesh(np.concatenate(vertices), np.concatenate(triangles), np.concatenate(albedo))
