# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ray-cast images of a textured corridor from a moving stereo camera with exactly known motion."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.types import FramePair

SHAPE = (240, 320)
CAMERA = np.array([[260.0, 0.0, 159.5], [0.0, 260.0, 119.5], [0.0, 0.0, 1.0]])
BASELINE_M = 0.2
TEXEL_M = 0.01
#: Floor, two side walls and end wall: axis of the normal, coordinate along it in metres, and the two axes
#: of the texture.
PLANES = ((1, 1.0, 0, 2), (0, -2.5, 1, 2), (0, 2.5, 1, 2), (2, 12.0, 0, 1))


def texture(seed: int, size: int = 1024) -> NDArray[np.float32]:
    """Return a periodic texture of shape (size, size): grey levels with equal energy in every octave."""
    rng = np.random.default_rng(seed)
    total = np.zeros((size, size), np.float32)
    for octave in range(1, 8):
        coarse = rng.normal(size=(size >> octave, size >> octave)).astype(np.float32)
        total += cv2.resize(np.pad(coarse, ((0, 1), (0, 1)), mode="wrap"), None, fx=2**octave, fy=2**octave)[
            :size, :size
        ]
    return np.asarray(128.0 + 40.0 * (total - total.mean()) / total.std(), dtype=np.float32)


def render(
    T_world_camera: NDArray[np.float64], rng: np.random.Generator, noise_dn: float = 1.5
) -> NDArray[np.uint8]:
    """Return an image of shape ``SHAPE``, uint8, from 2 × 2 rays per pixel with Gaussian noise."""
    rows, columns = SHAPE
    v, u = (np.mgrid[0 : 2 * rows, 0 : 2 * columns] + 0.5) / 2.0 - 0.5
    rays = np.stack(
        [(u - CAMERA[0, 2]) / CAMERA[0, 0], (v - CAMERA[1, 2]) / CAMERA[1, 1], np.ones_like(u)], axis=-1
    )
    rays = rays.reshape(-1, 3) @ T_world_camera[:3, :3].T
    origin, nearest = T_world_camera[:3, 3], np.full(len(rays), np.inf)
    image = np.full(len(rays), 128.0, np.float32)
    for index, (axis, value, texture_axis_x, texture_axis_y) in enumerate(PLANES):
        with np.errstate(divide="ignore"):
            distance = (value - origin[axis]) / rays[:, axis]
        hit = (distance > 0.05) & (distance < nearest)
        nearest = np.where(hit, distance, nearest)
        footprint = np.where(hit, distance, 1.0) / CAMERA[0, 0] / TEXEL_M / 2.0
        levels = np.clip(np.rint(np.log2(np.maximum(footprint, 1.0))), 0, 4).astype(int)
        for level in np.unique(levels[hit]):
            at_level = hit & (levels == level)
            grey = texture_of(index, int(level))
            n, size = len(grey), TEXEL_M * 2.0**level
            x = (origin[texture_axis_x] + distance[at_level] * rays[at_level, texture_axis_x]) / size
            y = (origin[texture_axis_y] + distance[at_level] * rays[at_level, texture_axis_y]) / size
            x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
            a, b = x - x0, y - y0
            x0, y0, x1, y1 = x0 % n, y0 % n, (x0 + 1) % n, (y0 + 1) % n
            top, bottom = (1 - a) * grey[y0, x0] + a * grey[y0, x1], (1 - a) * grey[y1, x0] + a * grey[y1, x1]
            image[at_level] = (1 - b) * top + b * bottom
    image_px = cv2.resize(image.reshape(2 * rows, 2 * columns), (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(np.clip(np.rint(image_px + rng.normal(0.0, noise_dn, SHAPE)), 0, 255), dtype=np.uint8)


@cache
def texture_of(plane: int, level: int) -> NDArray[np.float32]:
    """Return the texture of a plane, halved in size ``level`` times."""
    side = 1024 >> level
    return np.asarray(
        cv2.resize(texture(plane), (side, side), interpolation=cv2.INTER_AREA), dtype=np.float32
    )


def stereo_pair(T_world_left: NDArray[np.float64], stamp_ns: int, seed: int = 0) -> FramePair:
    """Return the stereo pair at a pose; stamp and seed determine the noise."""
    rng = np.random.default_rng([seed, stamp_ns // 1000])
    left = render(T_world_left, rng)
    right = render(T_world_left @ se3.transform(np.eye(3), [BASELINE_M, 0.0, 0.0]), rng)
    return FramePair.from_images(left, right, baseline_m=BASELINE_M, camera_matrix=CAMERA, stamp_ns=stamp_ns)


def drive(steps: int, step_m: float = 0.08) -> NDArray[np.float64]:
    """Return poses ``T_world_left`` (steps, 4, 4) of a forward drive with small rotations about all axes."""
    poses, T = [], np.eye(4)
    for i in range(steps):
        poses.append(T)
        rotation_rad = np.array([0.004 * np.sin(1.3 * i), 0.006, 0.003 * np.cos(0.9 * i)])
        T = T @ se3.transform(se3.exp_so3(rotation_rad), [0.01 * np.sin(i), 0.004 * np.cos(2.0 * i), step_m])
    return np.stack(poses)
