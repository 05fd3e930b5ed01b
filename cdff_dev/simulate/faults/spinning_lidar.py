# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The spinning lidar with the faults of a scenario."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.faults.lidar import (
    DUST_REFLECTANCE,
    LidarFaults,
    MountError,
    RingOffsets,
    beam_offsets,
    dust_ranges,
    echo,
    walk,
)
from cdff_dev.simulate.faults.solids import body_solids, cast, object_solids
from cdff_dev.simulate.lidar import Scan, column_times_us, directions, measured, reflectance
from cdff_dev.simulate.scenario import Lidar
from cdff_dev.simulate.world import World, generator


def draw_mount(model: Lidar, faults: LidarFaults, rng: np.random.Generator) -> FloatArray:
    """Return the true ``T_base_lidar``, shape (4, 4)."""
    error = faults.mount or MountError()
    R = se3.exp_so3(math.radians(error.rotation_sigma_deg) * rng.standard_normal(3))
    return model.mount.matrix() @ se3.transform(R, error.translation_sigma_m * rng.standard_normal(3))


class FaultyLidar:
    """Makes the scans of one rover, with the faults of the scenario.

    Parameters
    ----------
    scene : open3d.t.geometry.RaycastingScene
        Terrain (geometry 0) and rocks (geometry 1) in site.
    """

    def __init__(self, world: World, robot: str, scene: Any) -> None:
        scenario = world.scenario
        assert scenario.faults is not None  # the caller has checked it
        self._model, self._scene, self._world = scenario.lidar, scene, world
        self._motion, self._all_faults = world.motions[robot], scenario.faults
        self._faults = scenario.faults.lidar or LidarFaults()
        rng = generator(scenario, "fault_lidar_rig", sorted(scenario.robots).index(robot))
        self._T_base_lidar = draw_mount(self._model, self._faults, rng)
        rings = self._faults.rings or RingOffsets()
        self._ring_offset_m = rings.range_sigma_m * rng.standard_normal(self._model.rings)
        elevation_rad = math.radians(rings.elevation_sigma_deg) * rng.standard_normal(self._model.rings)
        self._beams = _tilt_rays(directions(self._model), elevation_rad[None, :], 0.0)
        offsets, self._weights = beam_offsets(self._faults.beam)
        self._rays = [_tilt_rays(self._beams, e, a) for e, a in offsets]

    def scan(self, t0_s: float, rng: np.random.Generator, fault_rng: np.random.Generator) -> Scan:
        """Return one revolution that starts at ``t0_s``, seconds since the epoch."""
        t_s = t0_s + column_times_us(self._model).astype(np.float64) * 1e-6
        T_site_base = self._motion.poses(t_s)
        T_site_lidar = T_site_base @ self._T_base_lidar
        solids = [
            *body_solids(self._all_faults.body or (), T_site_base, t_s),
            *object_solids(self._all_faults.objects or (), self._world.relief, t_s),
        ]
        ranges, powers = [], []
        for beams, weight in zip(self._rays, self._weights, strict=True):
            rays = np.einsum("cij,crj->cri", T_site_lidar[:, :3, :3], beams)
            origins = T_site_lidar[:, None, :3, 3]
            range_m, power = self._cast(origins, rays)
            hits = cast(solids, origins, rays)
            nearer = hits.t < range_m
            facing = np.abs(np.einsum("cri,cri->cr", hits.normals, rays))
            ranges.append(np.where(nearer, hits.t, range_m))
            powers.append(weight * np.where(nearer, hits.albedo * facing, power))
        range_m, power = echo(self._faults.beam, np.array(ranges), np.array(powers))
        if self._faults.range_walk is not None:
            range_m = walk(self._faults.range_walk, range_m, power)
        range_m = range_m + self._ring_offset_m
        if self._faults.dust is not None:
            azimuth = np.arctan2(self._beams[..., 1], self._beams[..., 0])
            dust = dust_ranges(self._faults.dust, azimuth, range_m.shape, fault_rng)
            power = np.where(dust < range_m, DUST_REFLECTANCE, power)
            range_m = np.minimum(dust, range_m)
        return measured(self._model, range_m, 1000.0 * power, rng)

    def _cast(self, origins: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return range and power ``(columns, rings)`` of the terrain and rocks."""
        import open3d as o3d

        origin_rays = np.empty((*rays.shape[:2], 6), dtype=np.float32)
        origin_rays[..., :3], origin_rays[..., 3:] = origins, rays
        hits = self._scene.cast_rays(o3d.core.Tensor.from_numpy(origin_rays), nthreads=1)
        cosine = np.abs(np.einsum("cri,cri->cr", hits["primitive_normals"].numpy(), origin_rays[..., 3:]))
        return hits["t_hit"].numpy().astype(np.float64), reflectance(hits["geometry_ids"].numpy()) * cosine


def _tilt_rays(
    beams: NDArray[np.float64], elevation_rad: FloatArray | float, across_rad: FloatArray | float
) -> FloatArray:
    """Return unit vectors ``(columns, rings, 3)``, moved by angles in elevation and across it."""
    horizontal = np.hypot(beams[..., 0], beams[..., 1])
    a = np.arctan2(beams[..., 1], beams[..., 0]) + across_rad / np.maximum(horizontal, 1e-6)
    e = np.arctan2(beams[..., 2], horizontal) + elevation_rad
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)
