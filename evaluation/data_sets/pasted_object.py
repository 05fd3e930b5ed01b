# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recorded stereo pairs with a pasted textured object, fixed to the robot or moving."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.types import FramePair

#: Standard deviation of the noise of the object's images, and of their blur, similar to recorded images.
_NOISE_DN, _BLUR_PX = 1.5, 0.6
#: Mean and standard deviation of the object's grey levels.
_MEAN_DN, _CONTRAST_DN = 120.0, 40.0


@dataclass(frozen=True, slots=True)
class PlanarObject:
    """A textured rectangle parallel to the image planes.

    Attributes
    ----------
    corner_px : tuple of float
        Column and row of the upper left corner in the first left image.
    size_px : tuple of int
        Columns and rows in the first left image.
    depth_m : float
        Distance along the optical axis in the first pair.
    step_m : tuple of float
        Motion relative to the camera from pair to pair, metres: right, down, forward. Zero for a part of the
        robot.
    seed : int
        Seed of texture and noise.
    """

    corner_px: tuple[float, float]
    size_px: tuple[int, int]
    depth_m: float
    step_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    seed: int = 1

    def coverage(self, pair: FramePair) -> float:
        """Return the fraction of the first left image that the object covers."""
        rows, columns = pair.left.image.shape[:2]
        (u, v), (width, height) = self.corner_px, self.size_px
        visible = (min(u + width, columns) - max(u, 0.0)) * (min(v + height, rows) - max(v, 0.0))
        return float(visible / (rows * columns))


def paste(pairs: Sequence[FramePair], planar_object: PlanarObject) -> list[FramePair]:
    """Return the pairs with the object in front of both images, at a consistent disparity."""
    texture = _texture(planar_object)
    rng = np.random.default_rng([planar_object.seed, 1])
    return [_with_object(pair, i, planar_object, texture, rng) for i, pair in enumerate(pairs)]


def mask_of(pairs: Sequence[FramePair], planar_object: PlanarObject, *, right: bool) -> NDArray[np.uint8]:
    """Return the mask image (rows, cols) of an object at rest: 0 on the object, 255 elsewhere."""
    shape = pairs[0].left.image.shape[:2]
    warp = _warp(pairs[0], 0, planar_object, right=right)
    ones = np.full((planar_object.size_px[1], planar_object.size_px[0]), 255.0, np.float32)
    covered = cv2.warpAffine(ones, warp, shape[::-1])
    return np.where(covered > 0.0, 0, 255).astype(np.uint8)


def _texture(planar_object: PlanarObject) -> NDArray[np.float32]:
    """Return grey levels (rows, cols) with structures of 2 to 32 px."""
    columns, rows = planar_object.size_px
    rng, total = np.random.default_rng(planar_object.seed), np.zeros((rows, columns), np.float32)
    for scale in (2, 4, 8, 16, 32):
        coarse = rng.normal(size=(rows // scale + 2, columns // scale + 2)).astype(np.float32)
        total += cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_CUBIC)
    total = cv2.GaussianBlur(total, (0, 0), _BLUR_PX).astype(np.float32)
    return np.asarray(_MEAN_DN + _CONTRAST_DN * (total - total.mean()) / total.std(), np.float32)


def _warp(pair: FramePair, index: int, planar_object: PlanarObject, *, right: bool) -> NDArray[np.float64]:
    """Return the affine map (2, 3) from texture to image of a pair."""
    K, step = pair.camera_matrix, index * np.array(planar_object.step_m)
    f, depth_m = float(K[0, 0]), planar_object.depth_m + float(step[2])
    scale = planar_object.depth_m / depth_m
    centre = np.array([K[0, 2], K[1, 2]])
    corner = centre + scale * (np.array(planar_object.corner_px) - centre) + f / depth_m * step[:2]
    if right:
        corner[0] -= f * pair.baseline / depth_m
    return np.array([[scale, 0.0, corner[0]], [0.0, scale, corner[1]]])


def _with_object(
    pair: FramePair,
    index: int,
    planar_object: PlanarObject,
    texture: NDArray[np.float32],
    rng: np.random.Generator,
) -> FramePair:
    """Return a pair with the object blended into both images."""
    images = []
    for frame, right in ((pair.left, False), (pair.right, True)):
        warp = _warp(pair, index, planar_object, right=right)
        size = frame.image.shape[1::-1]
        grey = cv2.warpAffine(texture, warp, size, flags=cv2.INTER_CUBIC)
        opaque = cv2.warpAffine(np.ones_like(texture), warp, size)
        noisy = grey + rng.normal(0.0, _NOISE_DN, grey.shape)
        blended = opaque * noisy + (1.0 - opaque) * np.asarray(frame.image, np.float64)
        images.append(np.clip(np.rint(blended), 0, 255).astype(np.uint8))
    return FramePair.from_images(
        *images,
        baseline_m=pair.baseline,
        camera_matrix=np.array(pair.camera_matrix),
        stamp_ns=pair.stamp_ns,
        sensor=pair.frame,
    )
