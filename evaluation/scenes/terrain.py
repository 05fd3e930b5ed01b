# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulate pairs of terrain clouds: independently sampled windows, and ray-cast lidar scans."""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray

WINDOW_M, POINTS, NOISE_M = 20.0, 30_000, 0.01
RINGS, COLUMNS, SENSOR_M, RANGE_M = 64, 1800, 1.6, 60.0
ELEVATION_DEG = (-26.0, 3.5)


class Terrain:
    """A fractal surface with rocks on a periodic grid; heights are interpolated linearly.

    Parameters
    ----------
    seed : int
    size_m, step_m : float
        Edge of the square and of a cell.
    rocks : int
        Number of half-buried ellipsoids of 0.1 to 0.5 m radius.
    """

    def __init__(self, seed: int, size_m: float = 64.0, step_m: float = 0.05, rocks: int = 250) -> None:
        rng = np.random.default_rng(seed)
        self.size_m, self.step_m = size_m, step_m
        n = round(size_m / step_m)
        frequency = np.hypot(
            *np.meshgrid(np.fft.fftfreq(n, step_m), np.fft.rfftfreq(n, step_m), indexing="ij")
        )
        frequency[0, 0] = np.inf
        spectrum = np.where(frequency < 1.0 / 32.0, 0.0, frequency**-2.0) * np.exp(
            2j * np.pi * rng.random(frequency.shape)
        )
        z = np.fft.irfft2(spectrum, s=(n, n))
        z *= 0.35 / z.std()
        x = np.arange(n) * step_m
        for cx, cy, radius in zip(
            *rng.uniform(0, size_m, (2, rocks)), rng.uniform(0.1, 0.5, rocks), strict=True
        ):
            i = slice(*np.clip(np.searchsorted(x, [cx - radius, cx + radius]), 0, n))
            j = slice(*np.clip(np.searchsorted(x, [cy - radius, cy + radius]), 0, n))
            inside = np.maximum(radius**2 - (x[i, None] - cx) ** 2 - (x[None, j] - cy) ** 2, 0.0)
            z[i, j] += rng.uniform(0.5, 1.0) * np.sqrt(inside)
        self.z_m = z

    def height(self, xy: FloatArray) -> FloatArray:
        """Return the heights ``(n,)`` at points ``(n, 2)`` inside the square, metres."""
        g = xy / self.step_m
        i, (u, v) = g.astype(int), (g % 1.0).T
        z = self.z_m
        z00, z10 = z[i[:, 0], i[:, 1]], z[i[:, 0] + 1, i[:, 1]]
        z01, z11 = z[i[:, 0], i[:, 1] + 1], z[i[:, 0] + 1, i[:, 1] + 1]
        return np.asarray((1 - u) * (1 - v) * z00 + u * (1 - v) * z10 + (1 - u) * v * z01 + u * v * z11)

    def window(self, rng: np.random.Generator, x_m: float, y_m: float) -> FloatArray:
        """Return noisy points (30 000, 3) of a window of 20 m with the given corner of smallest x and y."""
        xy = rng.uniform(0, WINDOW_M, (POINTS, 2)) + np.array([x_m, y_m])
        return np.c_[xy, self.height(xy)] + rng.normal(0, NOISE_M, (POINTS, 3))

    @cached_property
    def scene(self) -> Any:
        """Open3D scene for ray casting."""
        import open3d as o3d

        n = len(self.z_m)
        x, y = np.meshgrid(*(np.arange(n) * self.step_m,) * 2, indexing="ij")
        vertices = np.stack([x, y, self.z_m], axis=-1).reshape(-1, 3).astype(np.float32)
        index = np.arange(n * n, dtype=np.uint32).reshape(n, n)
        a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
        triangles = np.stack([np.stack([a, c, d], -1), np.stack([a, d, b], -1)]).reshape(-1, 3)
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(np.ascontiguousarray(triangles)))
        return scene

    def scan(self, rng: np.random.Generator, T_terrain_lidar: FloatArray) -> FloatArray:
        """Return the points (about 90 000, 3) of a revolution in the lidar frame, with 1 cm range noise."""
        import open3d as o3d

        azimuth = 2.0 * np.pi * np.arange(COLUMNS) / COLUMNS
        a, e = np.meshgrid(azimuth, np.radians(np.linspace(*ELEVATION_DEG, RINGS)), indexing="ij")
        beams = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1).reshape(-1, 3)
        rays = np.empty((len(beams), 6), np.float32)
        rays[:, :3], rays[:, 3:] = T_terrain_lidar[:3, 3], beams @ T_terrain_lidar[:3, :3].T
        range_m = self.scene.cast_rays(o3d.core.Tensor(rays), nthreads=1)["t_hit"].numpy().astype(np.float64)
        valid = (range_m > 1.0) & (range_m < RANGE_M)
        return beams[valid] * (range_m[valid] + rng.normal(0, NOISE_M, np.count_nonzero(valid)))[:, None]


@lru_cache(maxsize=2)
def terrain(seed: int) -> Terrain:
    """Return the terrain of a seed, shared by all pairs of this seed."""
    return Terrain(seed)


def window_pair(
    seed: int, overlap: float, *, other_terrain: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return two windows of the same terrain with random heading and tilts of 5 degrees.

    Parameters
    ----------
    seed : int
    overlap : float
        Common fraction of the area of a window; 0 places the windows 4 m apart.
    other_terrain : bool
        True if the target is on the terrain of another seed; then there is no correct pose.

    Returns
    -------
    tuple of ndarray
        Source (relative to its centre), target, and T_target_source.
    """
    rng = np.random.default_rng([seed, round(100 * overlap), other_terrain])
    distance_m = WINDOW_M * (1.0 - overlap) if overlap > 0.0 else 1.2 * WINDOW_M
    source = terrain(seed).window(rng, 1.0, 5.0)
    target = terrain(seed + 1 if other_terrain else seed).window(
        rng, 1.0 + distance_m, 25.0 if other_terrain else 5.0
    )
    centre = source.mean(axis=0)
    R = se3.exp_so3(np.radians(rng.normal(0, 5.0, 3))) @ se3.exp_so3(
        np.array([0, 0, rng.uniform(-np.pi, np.pi)])
    )
    T_target_terrain = se3.transform(R, rng.normal(0, 10.0, 3) - R @ centre)
    # The source is centred on its origin, so that the translation error is the error at the cloud.
    return (
        source - centre,
        se3.transform_points(T_target_terrain, target),
        T_target_terrain @ se3.transform(np.eye(3), centre),
    )


def scan_pair(seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return two lidar scans of the same terrain from poses up to 1.1 m and 4 degrees apart.

    Returns
    -------
    tuple of ndarray
        Scene and model, about 90 000 points each, and T_scene_model.
    """
    rng = np.random.default_rng([seed, 64])
    ground = Terrain(seed, size_m=120.0, step_m=0.2, rocks=400)
    xy = rng.uniform(55.0, 65.0, 2)
    heading, tilt = rng.uniform(-np.pi, np.pi), np.radians(rng.normal(0, 2.0, 2))
    R = se3.exp_so3(np.array([0, 0, heading])) @ se3.exp_so3(np.array([*tilt, 0.0]))
    T_terrain_scene = se3.transform(R, [*xy, ground.height(xy[None])[0] + SENSOR_M])
    axis = rng.normal(size=3)
    rotation_rad = np.radians(rng.uniform(0.5, 4.0)) * axis / np.linalg.norm(axis)
    distance_m, bearing = rng.uniform(0.3, 1.1), rng.uniform(-np.pi, np.pi)
    T_scene_model = se3.transform(
        se3.exp_so3(rotation_rad),
        [distance_m * np.cos(bearing), distance_m * np.sin(bearing), rng.normal(0, 0.02)],
    )
    return ground.scan(rng, T_terrain_scene), ground.scan(rng, T_terrain_scene @ T_scene_model), T_scene_model
