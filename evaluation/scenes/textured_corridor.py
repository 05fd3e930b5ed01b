# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rectified stereo pairs of a drive around a square corridor with random textures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.types import FramePair

#: Half the side of the outer and of the inner square, height of the walls and of the camera, metres.
_OUTER_M, _INNER_M, _HEIGHT_M, _CAMERA_M = 8.0, 4.0, 3.0, 1.2
_PIXELS_PER_M, _SIZE, _FOCAL_PX, BASELINE_M = 60, (376, 240), 216.0, 0.11
_NOISE = 2.0
#: Axes of a camera that looks along x of the world, whose z axis points up.
_R_WORLD_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """Rectangle with a texture: a corner, two axes of unit length and their extents."""

    corner: FloatArray
    axes: FloatArray  # (2, 3)
    extents_m: tuple[float, float]
    texture: Image


class Corridor:
    """Corridor between two squares.

    With ``twins`` all four sides have the same textures, so that four places look the same. The images have
    376 x 240 pixels times ``magnification``.
    """

    def __init__(self, seed: int, *, twins: bool = False, magnification: int = 1) -> None:
        self._rng = np.random.default_rng(seed)
        self._size = (magnification * _SIZE[0], magnification * _SIZE[1])
        focal_px = magnification * _FOCAL_PX
        columns, rows = self._size
        self._K = np.array(
            [[focal_px, 0, columns / 2 - 0.5], [0, focal_px, rows / 2 - 0.5], [0, 0, 1.0]], np.float64
        )
        self._surfaces = []
        for half in (_OUTER_M, _INNER_M):
            shared = self._texture(2 * half, _HEIGHT_M)
            for side in range(4):
                R = se3.exp_so3([0.0, 0.0, 0.5 * np.pi * side])
                texture = shared if twins else self._texture(2 * half, _HEIGHT_M)
                axes = np.array([R @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
                corner = R @ np.array([half, -half, 0.0])
                self._surfaces.append(_Surface(corner, axes, (2 * half, _HEIGHT_M), texture))
        # Four triangles would repeat exactly; the floor of twins has no texture instead.
        floor = self._texture(2 * _OUTER_M, 2 * _OUTER_M)
        if twins:
            floor[:] = 128
        axes = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        corner = np.array([-_OUTER_M, -_OUTER_M, 0.0])
        self._surfaces.append(_Surface(corner, axes, (2 * _OUTER_M, 2 * _OUTER_M), floor))

    def pair(self, T_world_left: FloatArray) -> FramePair:
        """Return the rectified pair of a left camera."""
        T_right = T_world_left @ se3.transform(np.eye(3), [BASELINE_M, 0.0, 0.0])
        images = [self._view(T) for T in (T_world_left, T_right)]
        return FramePair.from_images(*images, baseline_m=BASELINE_M, camera_matrix=self._K, stamp_ns=0)

    def _view(self, T_world_camera: FloatArray) -> Image:
        columns, rows = np.meshgrid(np.arange(self._size[0]), np.arange(self._size[1]))
        x, y = (columns - self._K[0, 2]) / self._K[0, 0], (rows - self._K[1, 2]) / self._K[1, 1]
        rays = np.stack([x, y, np.ones(columns.shape)], axis=-1) @ T_world_camera[:3, :3].T
        origin = T_world_camera[:3, 3]
        nearest, image = np.full(columns.shape, np.inf), np.full(columns.shape, 90.0, np.float32)
        for surface in self._surfaces:
            normal = np.cross(*surface.axes)
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = (normal @ (surface.corner - origin)) / (rays @ normal)
            at = origin + np.nan_to_num(depth, posinf=0.0, neginf=0.0)[..., None] * rays - surface.corner
            u, v = at @ surface.axes[0], at @ surface.axes[1]
            hit = (depth > 0.05) & (depth < nearest)
            hit &= (u >= 0) & (u < surface.extents_m[0]) & (v >= 0) & (v < surface.extents_m[1])
            grey = cv2.remap(
                surface.texture,
                np.asarray(u * _PIXELS_PER_M, np.float32),
                np.asarray(v * _PIXELS_PER_M, np.float32),
                cv2.INTER_LINEAR,
            )
            image[hit], nearest[hit] = grey[hit], depth[hit]
        noisy = image + self._rng.normal(0.0, _NOISE, image.shape)
        return np.asarray(np.clip(noisy, 0, 255), np.uint8)

    def _texture(self, width_m: float, height_m: float) -> Image:
        shape = (int(height_m * _PIXELS_PER_M), int(width_m * _PIXELS_PER_M))
        layers = [cv2.GaussianBlur(self._rng.normal(size=shape), (0, 0), s) * s for s in (1.0, 2.5, 6.0)]
        total = np.asarray(sum(layers))
        return np.asarray(np.clip(128.0 + 55.0 * total / total.std(), 0, 255), np.uint8)


def drive(laps: float, step_m: float) -> Iterator[FloatArray]:
    """Yield ``T_world_left`` along the centre line of the corridor, with rounded corners."""
    radius_m = 1.2
    half = 0.5 * (_OUTER_M + _INNER_M)
    straight_m, arc_m = 2 * (half - radius_m), 0.5 * np.pi * radius_m
    side_m = straight_m + arc_m
    for s in np.arange(0.0, 4 * laps * side_m, step_m):
        side, along = divmod(float(s), side_m)
        # The first side leads north at the east of the inner square.
        if along < straight_m:
            position, heading = np.array([half, along - straight_m / 2]), 0.5 * np.pi
        else:
            angle = (along - straight_m) / radius_m
            centre = np.array([half - radius_m, straight_m / 2])
            position = centre + radius_m * np.array([np.cos(angle), np.sin(angle)])
            heading = 0.5 * np.pi + angle
        R = se3.exp_so3([0.0, 0.0, 0.5 * np.pi * side])
        R_world_camera = R @ se3.exp_so3([0.0, 0.0, heading]) @ _R_WORLD_CAMERA
        yield se3.transform(R_world_camera, R @ np.array([*position, _CAMERA_M]))
