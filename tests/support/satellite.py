# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A satellite as a CAD program would export it, other bodies, and lidar scans of them by Open3D."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3

Vertices = NDArray[np.float64]
Triangles = NDArray[np.int64]

_BOX_FACES = np.array(
    [
        (0, 1, 3),
        (0, 3, 2),
        (4, 6, 7),
        (4, 7, 5),
        (0, 4, 5),
        (0, 5, 1),
        (2, 3, 7),
        (2, 7, 6),
        (0, 2, 6),
        (0, 6, 4),
        (1, 5, 7),
        (1, 7, 3),
    ]
)


def box(size_m: tuple[float, float, float], centre_m: tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    """Return a box with 8 vertices and 12 triangles."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    return 0.5 * signs * size_m + centre_m, _BOX_FACES


def cylinder(radius_m: float, length_m: float, sides: int = 48) -> Mesh:
    """Return a closed cylinder along z."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends = [np.column_stack([ring, np.full(sides, z)]) for z in (-0.5 * length_m, 0.5 * length_m)]
    vertices = np.vstack([*ends, [[0, 0, -0.5 * length_m], [0, 0, 0.5 * length_m]]])
    i, j = np.arange(sides), np.roll(np.arange(sides), -1)
    top, low, high = sides, np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    quads = [(i, j, top + i), (j, top + j, top + i), (j, i, low), (top + i, top + j, high)]
    return vertices, np.concatenate([np.stack(q, axis=1) for q in quads])


def merged(*meshes: Mesh) -> Mesh:
    """Return several meshes as one."""
    offsets = np.cumsum([0, *(len(v) for v, _ in meshes)])
    triangles = [t + offset for (_, t), offset in zip(meshes, offsets, strict=False)]
    return np.vstack([v for v, _ in meshes]), np.concatenate(triangles)


def satellite() -> Mesh:
    """Return a body 1.2 m long with one solar panel, a dish, and invisible equipment inside.

    It has no symmetry. The faces of the panel are inverted.
    """
    dish_vertices, dish_triangles = cylinder(0.18, 0.1, 24)
    panel_vertices, panel_triangles = box((0.7, 0.02, 0.5), (0.75, 0.0, 0.1))
    return merged(
        box((0.8, 0.6, 0.5)),
        (panel_vertices, panel_triangles[:, ::-1]),
        (dish_vertices + np.array([-0.15, 0.1, 0.32]), dish_triangles),
        box((0.1, 0.1, 0.3), (-0.3, -0.2, -0.38)),
        box((0.5, 0.4, 0.3)),
        box((0.2, 0.1, 0.1), (0.1, 0.0, 0.0)),
    )


def scan(
    mesh: Mesh,
    T_sensor_model: NDArray[np.float64],
    *,
    pixels: int,
    field_deg: float,
    sigma_m: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Return the points (n, 3) of a square lidar image along z, with noise along the rays."""
    import open3d as o3d

    tangent = np.tan(np.radians(0.5 * field_deg)) * ((np.arange(pixels) + 0.5) / pixels * 2.0 - 1.0)
    u, v = np.meshgrid(tangent, tangent)
    rays = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    vertices = se3.transform_points(T_sensor_model, mesh[0])
    scene.add_triangles(
        o3d.core.Tensor(vertices.astype(np.float32)), o3d.core.Tensor(mesh[1].astype(np.uint32))
    )
    query = np.hstack([np.zeros_like(rays), rays]).astype(np.float32)
    ranges = scene.cast_rays(o3d.core.Tensor(query))["t_hit"].numpy().astype(np.float64)
    hit = np.isfinite(ranges)
    noise = rng.normal(0.0, sigma_m, np.count_nonzero(hit))
    return np.asarray(rays[hit] * (ranges[hit] + noise)[:, None])


def random_pose(rng: np.random.Generator, range_m: float) -> NDArray[np.float64]:
    """Return T_sensor_model of a random orientation, near the axis of the sensor."""
    q = rng.normal(size=4)
    R = se3.matrix_from_quaternion_xyzw(q / np.linalg.norm(q))
    return se3.transform(R, [*rng.uniform(-0.02, 0.02, 2) * range_m, range_m])


Mesh = tuple[Vertices, Triangles]
