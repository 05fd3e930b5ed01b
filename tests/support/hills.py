# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Unbounded hilly ground, and lidar sweeps over it without occlusion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.types import LidarScan

Float = NDArray[np.float64]
Ground = Callable[[Float, Float], Float]

#: Horizontal radii of the rings of a sweep, m.
RINGS_M = np.geomspace(1.2, 22.0, 40)
#: Azimuth steps of a sweep.
COLUMNS = 240
#: Height of the lidar above the ground.
HEIGHT_M = 1.2


def hills(seed: int = 0) -> Ground:
    """Return a height function, in metres: waves of 3 to 25 m length in all directions."""
    rng = np.random.default_rng(seed)
    length, azimuth, phase = (
        rng.uniform(3.0, 25.0, 24),
        rng.uniform(0, 2 * np.pi, 24),
        rng.uniform(0, 2 * np.pi, 24),
    )
    kx, ky = 2 * np.pi / length * np.cos(azimuth), 2 * np.pi / length * np.sin(azimuth)

    def height(x: Float, y: Float) -> Float:
        waves = np.sin(np.multiply.outer(x, kx) + np.multiply.outer(y, ky) + phase)
        return np.asarray(waves @ (0.008 * length))

    return height


def flat_ground(x: Float, y: Float) -> Float:
    """Return the heights of flat ground: zeros."""
    return np.zeros(np.broadcast(x, y).shape)


def pose_on_ground(ground: Ground, x: float, y: float, yaw: float) -> Float:
    """Return ``T_site_lidar`` of a lidar at a point, ``HEIGHT_M`` above the ground, z along its normal."""
    step_m = 0.5
    slope_x = float(ground(np.array(x + step_m), np.array(y)) - ground(np.array(x - step_m), np.array(y))) / (
        2 * step_m
    )
    slope_y = float(ground(np.array(x), np.array(y + step_m)) - ground(np.array(x), np.array(y - step_m))) / (
        2 * step_m
    )
    normal = np.array([-slope_x, -slope_y, 1.0]) / np.linalg.norm([slope_x, slope_y, 1.0])
    forward = np.array([np.cos(yaw), np.sin(yaw), slope_x * np.cos(yaw) + slope_y * np.sin(yaw)])
    forward /= np.linalg.norm(forward)
    R = np.column_stack([forward, np.cross(normal, forward), normal])
    z = float(ground(np.array(x), np.array(y)))
    return se3.transform(se3.normalise_rotation(R), np.array([x, y, z]) + HEIGHT_M * normal)


def sweep_points(
    ground: Ground,
    T_start: Float,
    T_end: Float,
    rng: np.random.Generator,
    noise_m: float = 0.003,
    rings_m: Float = RINGS_M,
) -> tuple[Float, Float]:
    """Return points ``(n, 3)``, each in the lidar frame at its own time, and their times ``(n,)`` from -1
    (start) to 0 (end).

    The points lie on rings on the ground around the lidar. The azimuths are random, so that no two sweeps
    share a point.
    """
    fraction = np.repeat(np.arange(COLUMNS) / COLUMNS - 1.0, len(rings_m))
    azimuth = fraction * 2 * np.pi + rng.uniform(0, 2 * np.pi)
    range_m = np.tile(rings_m, COLUMNS) * rng.uniform(0.99, 1.01, len(fraction))
    t = T_end[:3, 3] + fraction[:, None] * (T_end[:3, 3] - T_start[:3, 3])
    phi = se3.log_so3(T_start[:3, :3].T @ T_end[:3, :3])
    R = T_end[:3, :3] @ se3.exp_so3(fraction[:, None] * phi)
    x, y = t[:, 0] + range_m * np.cos(azimuth), t[:, 1] + range_m * np.sin(azimuth)
    site = np.column_stack([x, y, ground(x, y)]) + rng.normal(0, noise_m, (len(x), 3))
    return np.einsum("nji,nj->ni", R, site - t), fraction


def scan(ground: Ground, T_start: Float, T_end: Float, t1_ns: int, rng: np.random.Generator) -> LidarScan:
    """Return a sweep of 0.1 s as a message of robot ``mana``."""
    points, fraction = sweep_points(ground, T_start, T_end, rng)
    offset_us = np.round((fraction + 1.0) * 100_000).astype(np.uint32)
    frame = "mana/lidar"
    return LidarScan.from_arrays(points, offset_us, frame=frame, t0_ns=t1_ns - 100_000_000, t1_ns=t1_ns)


def circle(ground: Ground, radius_m: float, distance_m: Float) -> list[Float]:
    """Return ``T_site_lidar`` along a left-hand circle that starts at the origin in direction x."""
    angles_rad = distance_m / radius_m
    return [pose_on_ground(ground, radius_m * np.sin(a), radius_m * (1.0 - np.cos(a)), a) for a in angles_rad]
