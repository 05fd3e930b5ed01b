# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Hilly ground without end, and the sweeps of a lidar that drives on it; nothing hides anything."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.types import LidarScan

Float = NDArray[np.float64]
Ground = Callable[[Float, Float], Float]

#: Ground ranges of the rings, metres.
RINGS_M = np.geomspace(1.2, 22.0, 40)
COLUMNS = 240
HEIGHT_M = 1.2


def hills(seed: int = 0) -> Ground:
    """Heights of waves of 3 to 25 m length in all directions, metres."""
    rng = np.random.default_rng(seed)
    length, turn, phase = rng.uniform(3.0, 25.0, 24), rng.uniform(0, 2 * np.pi, 24), rng.uniform(0, 2 * np.pi, 24)
    kx, ky = 2 * np.pi / length * np.cos(turn), 2 * np.pi / length * np.sin(turn)

    def height(x: Float, y: Float) -> Float:
        waves = np.sin(np.multiply.outer(x, kx) + np.multiply.outer(y, ky) + phase)
        return np.asarray(waves @ (0.008 * length))

    return height


def plain(x: Float, y: Float) -> Float:
    """Ground without relief."""
    return np.zeros(np.broadcast(x, y).shape)


def standing(ground: Ground, x: float, y: float, yaw: float) -> Float:
    """``T_site_lidar`` of a lidar that stands on the ground at a point, its z along the ground's normal."""
    step = 0.5
    slope_x = float(ground(np.array(x + step), np.array(y)) - ground(np.array(x - step), np.array(y))) / (2 * step)
    slope_y = float(ground(np.array(x), np.array(y + step)) - ground(np.array(x), np.array(y - step))) / (2 * step)
    normal = np.array([-slope_x, -slope_y, 1.0]) / np.linalg.norm([slope_x, slope_y, 1.0])
    ahead = np.array([np.cos(yaw), np.sin(yaw), slope_x * np.cos(yaw) + slope_y * np.sin(yaw)])
    ahead /= np.linalg.norm(ahead)
    R = np.column_stack([ahead, np.cross(normal, ahead), normal])
    z = float(ground(np.array(x), np.array(y)))
    return se3.transform(se3.normalise_rotation(R), np.array([x, y, z]) + HEIGHT_M * normal)


def sweep_points(
    ground: Ground,
    T_begin: Float,
    T_end: Float,
    rng: np.random.Generator,
    noise_m: float = 0.003,
    rings_m: Float = RINGS_M,
) -> tuple[Float, Float]:
    """Points ``(n, 3)``, each in the lidar's frame at its own time, and the fraction ``(n,)`` of the sweep, -1 to 0.

    Rings are drawn on the ground around the lidar, turned by chance, so that no two sweeps share a point.
    """
    fraction = np.repeat(np.arange(COLUMNS) / COLUMNS - 1.0, len(rings_m))
    turn = fraction * 2 * np.pi + rng.uniform(0, 2 * np.pi)
    range_m = np.tile(rings_m, COLUMNS) * rng.uniform(0.99, 1.01, len(fraction))
    t = T_end[:3, 3] + fraction[:, None] * (T_end[:3, 3] - T_begin[:3, 3])
    phi = se3.log_so3(T_begin[:3, :3].T @ T_end[:3, :3])
    R = T_end[:3, :3] @ se3.exp_so3(fraction[:, None] * phi)
    x, y = t[:, 0] + range_m * np.cos(turn), t[:, 1] + range_m * np.sin(turn)
    site = np.column_stack([x, y, ground(x, y)]) + rng.normal(0, noise_m, (len(x), 3))
    return np.einsum("nji,nj->ni", R, site - t), fraction


def scan(ground: Ground, T_begin: Float, T_end: Float, t1_ns: int, rng: np.random.Generator) -> LidarScan:
    """A sweep of 0.1 s as a message of robot ``mana``."""
    points, fraction = sweep_points(ground, T_begin, T_end, rng)
    offset_us = np.round((fraction + 1.0) * 100_000).astype(np.uint32)
    frame = "mana/lidar"
    return LidarScan.from_arrays(points, offset_us, frame=frame, t0_ns=t1_ns - 100_000_000, t1_ns=t1_ns)


def circle(ground: Ground, radius_m: float, way_m: Float) -> list[Float]:
    """``T_site_lidar`` along a circle to the left that begins at the origin along x."""
    turn = way_m / radius_m
    return [standing(ground, radius_m * np.sin(a), radius_m * (1.0 - np.cos(a)), a) for a in turn]
