# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Views of two textured walls at different depths, by a camera without lens distortion."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from cdff_common.geometry import se3
from cdff_common.types import DistanceImage, FramePair, PoseGraph, VisualMap
from cdff_core.visual_map.keyframe_points import points_of_pair
from cdff_dev.map_building.build import localisation_features

K = np.array([[240.0, 0.0, 160.0], [0.0, 240.0, 120.0], [0.0, 0.0, 1.0]])
SIZE, BASELINE_M = (320, 240), 0.12
#: Depth, left edge and width of each wall, metres; both are 3 m high.
_WALLS = ((4.0, -3.0, 6.0), (2.5, 0.1, 2.0))
#: A single plane.
PLANE = ((3.0, -3.0, 6.0),)
_PIXELS_PER_M = 120.0


@cache
def texture(seed: int, width_m: float, height_m: float) -> np.ndarray:
    """Return a random grey texture with structure of several sizes."""
    rng = np.random.default_rng(seed)
    shape = (int(height_m * _PIXELS_PER_M), int(width_m * _PIXELS_PER_M))
    layers = [cv2.GaussianBlur(rng.normal(size=shape), (0, 0), s) * s for s in (1.5, 3.0, 6.0)]
    total = sum(layers)
    return np.clip(128.0 + 60.0 * total / total.std(), 0, 255).astype(np.uint8)


def view(
    T_world_camera: np.ndarray, seed: int = 0, planes: tuple[tuple[float, float, float], ...] = _WALLS
) -> np.ndarray:
    """Return the image (240, 320) of the walls of a seed; ``planes`` as ``_WALLS``."""
    image = np.zeros(SIZE[::-1], np.uint8)
    T = se3.inverse(T_world_camera)
    for number, (z, x, width) in enumerate(planes):
        picture = texture(10 * seed + number, width, 3.0)
        # Pixel of the texture to point on the wall, to pixel of the image.
        wall = np.array([[1 / _PIXELS_PER_M, 0, x], [0, 1 / _PIXELS_PER_M, -1.5], [0, 0, z], [0, 0, 1]])
        H = K @ (T[:3] @ wall)
        warped = cv2.warpPerspective(picture, H, SIZE, flags=cv2.INTER_LINEAR)
        covers = cv2.warpPerspective(np.full_like(picture, 255), H, SIZE, flags=cv2.INTER_NEAREST)
        image[covers > 0] = warped[covers > 0]
    return image


def depth(T_world_camera: np.ndarray) -> DistanceImage:
    """Return the depth image of the walls, registered with the image; 0 beyond their edges."""
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    scale = 1.0 / K[0, 0]
    rays = np.stack([(columns - K[0, 2]) * scale, (rows - K[1, 2]) * scale, np.ones(columns.shape)], axis=-1)
    directions, origin = rays @ T_world_camera[:3, :3].T, T_world_camera[:3, 3]
    image = np.zeros(columns.shape, np.float32)
    for z, x, width in _WALLS:
        depths = (z - origin[2]) / directions[..., 2]
        hit = origin + depths[..., None] * directions
        is_on_wall = (hit[..., 0] >= x) & (hit[..., 0] < x + width) & (np.abs(hit[..., 1]) < 1.5)
        image[is_on_wall] = depths[is_on_wall]
    return DistanceImage(
        width=SIZE[0],
        height=SIZE[1],
        scale_x=scale,
        scale_y=scale,
        center_x=-K[0, 2] * scale,
        center_y=-K[1, 2] * scale,
        data=image.ravel(),
    )


def pair(
    T_world_left: np.ndarray, seed: int = 0, planes: tuple[tuple[float, float, float], ...] = _WALLS
) -> FramePair:
    """Return the rectified pair of the walls of a seed; ``planes`` as ``_WALLS``."""
    T_right = T_world_left @ se3.transform(np.eye(3), [BASELINE_M, 0.0, 0.0])
    return FramePair.from_images(
        view(T_world_left, seed, planes),
        view(T_right, seed, planes),
        baseline_m=BASELINE_M,
        camera_matrix=K,
        stamp_ns=0,
    )


def wall_map(poses: list[np.ndarray], seed: int = 0) -> VisualMap:
    """Return the map of the walls from pairs at ``T_world_left``, without priors."""
    extractor, match = localisation_features()
    ids = np.arange(len(poses))
    graph = PoseGraph.from_arrays(
        ids,
        np.zeros(len(ids), np.int64),
        np.array(poses),
        np.zeros((0, 2), np.int64),
        np.zeros((0, 4, 4)),
        np.zeros((0, 6, 6)),
        np.zeros(0, np.int64),
        frame="site",
    )
    points = [points_of_pair(pair(T, seed), extractor, match) for T in poses]
    return VisualMap.from_parts(
        graph, points, sensor="rover/navcam", stamp_ns=0, descriptor_type="ROOT_SIFT", producer="test"
    )
