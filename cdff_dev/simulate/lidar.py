# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated spinning lidar: each column is cast from the pose of the rover at the time of the column."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.rover_motion import Motion
from cdff_dev.simulate.scenario import Lidar
from cdff_dev.simulate.surface import Float32Array


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One revolution, not corrected for the motion of the lidar during it.

    Attributes
    ----------
    points_m : NDArray[np.float32], shape (n, 3)
        Each point in the lidar frame at the time of the point.
    time_offset_us : NDArray[np.uint32], shape (n,)
        Time since the start of the scan.
    intensity : NDArray[np.uint16], shape (n,)
        Reflectance times cosine of incidence, 0 to 1000.
    ring : NDArray[np.uint16], shape (n,)
        Index of the beam, from the lowest elevation.
    """

    points_m: Float32Array
    time_offset_us: NDArray[np.uint32]
    intensity: NDArray[np.uint16]
    ring: NDArray[np.uint16]


def directions(model: Lidar) -> NDArray[np.float64]:
    """Return unit vectors ``(columns, rings, 3)`` of the beams in the lidar frame; azimuth from -pi to pi."""
    azimuth = -math.pi + 2.0 * math.pi * np.arange(model.columns) / model.columns
    elevation = np.radians(np.linspace(model.elevation_min_deg, model.elevation_max_deg, model.rings))
    a, e = np.meshgrid(azimuth, elevation, indexing="ij")
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)


def scan(model: Lidar, scene: Any, motion: Motion, t0_s: float, rng: np.random.Generator) -> Scan:
    """Return one revolution that starts at ``t0_s``.

    Parameters
    ----------
    scene : open3d.t.geometry.RaycastingScene
        Terrain (geometry 0) and rocks (geometry 1) in site.
    """
    import open3d as o3d

    beams, offset_us = directions(model), column_times_us(model)
    T_site_lidar = motion.poses(t0_s + offset_us.astype(np.float64) * 1e-6) @ model.mount.matrix()
    rays = np.empty((model.columns, model.rings, 6), dtype=np.float32)
    rays[..., :3] = T_site_lidar[:, None, :3, 3]
    rays[..., 3:] = np.einsum("cij,crj->cri", T_site_lidar[:, :3, :3], beams)
    hits = scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)
    range_m = hits["t_hit"].numpy().astype(np.float64)
    cosine = np.abs(np.einsum("cri,cri->cr", hits["primitive_normals"].numpy(), rays[..., 3:]))
    return measured(model, range_m, 1000.0 * reflectance(hits["geometry_ids"].numpy()) * cosine, rng)


def reflectance(geometry: NDArray[np.uint32]) -> FloatArray:
    """Return the reflectance of hits on rocks (geometry 1 of the scene), terrain and nothing."""
    return np.where(geometry == 1, 0.75, 0.6)


def column_times_us(model: Lidar) -> NDArray[np.uint32]:
    """Return the time ``(columns,)`` of each column since the start of a revolution, microseconds."""
    return np.round(np.arange(model.columns) * model.sweep_s / model.columns * 1e6).astype(np.uint32)


def measured(model: Lidar, range_m: FloatArray, intensity: FloatArray, rng: np.random.Generator) -> Scan:
    """Return the scan of the measured ranges, with noise and without undetected points.

    Parameters
    ----------
    range_m : NDArray[np.float64], shape (columns, rings)
        Infinite where there is no echo.
    intensity : NDArray[np.float64], shape (columns, rings)
        1000 times reflectance and cosine of incidence.
    """
    noise = model.range_sigma_m * rng.standard_normal(range_m.shape)
    dropped = rng.random(range_m.shape) < model.dropout
    speckle = 1.0 + 0.08 * rng.standard_normal(range_m.shape)
    detected = np.isfinite(range_m) & (range_m > model.range_min_m) & (range_m < model.range_max_m) & ~dropped
    column, ring = np.nonzero(detected)
    points = (directions(model)[detected] * (range_m + noise)[detected][:, None]).astype(np.float32)
    counts = np.clip(intensity * speckle, 0, 1000)[detected].astype(np.uint16)
    return Scan(points, column_times_us(model)[column], counts, ring.astype(np.uint16))
