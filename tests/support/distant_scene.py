# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of textured ground with bodies that move in front of it, for a camera or a stereo pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from cdff_common.camera import CameraModel
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import Frame, FramePair

CAMERA = CameraModel(160, 240, 400.0, 400.0, 119.5, 79.5)
T0_NS, PERIOD_NS = 1_700_000_000_000_000_000, 500_000_000
BASELINE_M = 0.3


@dataclass(frozen=True)
class Body:
    """A body with a texture of its own.

    Attributes
    ----------
    start_px, velocity_px : tuple of float
        Place of the centre in the first image, and its change from image to image.
    size_px : tuple of int
        Width and height.
    level : float
        Mean grey level.
    disparity_px : float
    """

    start_px: tuple[float, float]
    velocity_px: tuple[float, float]
    size_px: tuple[int, int] = (20, 14)
    level: float = 190.0
    seed: int = 1
    disparity_px: float = 3.0

    def place(self, k: int) -> np.ndarray:
        """Return the centre in an image (2,)."""
        return np.array(self.start_px) + k * np.array(self.velocity_px)


@dataclass
class DistantScene:
    """Ground, bodies, and an occluder (first and last column) in front of them."""

    bodies: Sequence[Body]
    occluder: tuple[int, int] | None = None
    pan_px: float = 0.0
    seed: int = 0
    ground: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        noise = rng.normal(0.0, 1.0, (CAMERA.rows, CAMERA.cols + 200)).astype(np.float32)
        fine, coarse = cv2.GaussianBlur(noise, (0, 0), 1.5), cv2.GaussianBlur(noise, (0, 0), 6.0)
        self.ground = 100.0 + 8.0 * fine / fine.std() + 8.0 * coarse / coarse.std()

    def image(self, k: int, shift_px: float = 0.0, *, is_right: bool = False) -> np.ndarray:
        """Return the grey image of a time."""
        rng = np.random.default_rng([self.seed, k, int(is_right)])
        offset = 100.0 + self.pan_px * k + shift_px
        M = np.array([[1.0, 0.0, offset], [0.0, 1.0, 0.0]])
        size, flags = (CAMERA.cols, CAMERA.rows), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        ground = cv2.warpAffine(self.ground, M, size, flags=flags)
        light = ground.copy()
        for body in self.bodies:
            place = body.place(k) - [self.pan_px * k, 0.0]
            self._paint(light, body, place - [body.disparity_px if is_right else 0.0, 0.0])
        if self.occluder is not None:
            first, last = (max(round(x - self.pan_px * k), 0) for x in self.occluder)
            light[:, first:last] = ground[:, first:last] - 40.0
        light = cv2.GaussianBlur(light, (0, 0), 0.6)
        return np.clip(np.rint(light + rng.normal(0.0, 1.5, light.shape)), 0, 255).astype(np.uint8)

    @staticmethod
    def _paint(light: np.ndarray, body: Body, place: np.ndarray) -> None:
        w, h = body.size_px
        rng = np.random.default_rng(body.seed)
        texture = body.level + cv2.GaussianBlur(rng.normal(0.0, 40.0, (h, w)), (0, 0), 1.2)
        first = place - 0.5 * (np.array([w, h]) - 1.0)
        M = np.array([[1.0, 0.0, first[0]], [0.0, 1.0, first[1]]])
        size = (light.shape[1], light.shape[0])
        alpha = cv2.warpAffine(np.ones((h, w)), M, size, flags=cv2.INTER_LINEAR)
        painted = cv2.warpAffine(texture, M, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        light[:] = light * (1.0 - alpha) + painted * alpha

    def sample(self, k: int, image: np.ndarray | None = None) -> Sample:
        """Return the sample of an image."""
        stamp_ns = T0_NS + k * PERIOD_NS
        frame = Frame.from_image(
            self.image(k) if image is None else image,
            stamp_ns=stamp_ns,
            sensor="robot/camera",
            camera_matrix=CAMERA.matrix,
        )
        return Sample("image", stamp_ns, k, frame, id=f"i{k}", frame="robot/camera")

    def pair(self, k: int) -> Sample:
        """Return the sample of a stereo pair."""
        stamp_ns = T0_NS + k * PERIOD_NS
        value = FramePair.from_images(
            self.image(k),
            self.image(k, 0.5, is_right=True),
            baseline_m=BASELINE_M,
            camera_matrix=CAMERA.matrix,
            stamp_ns=stamp_ns,
            sensor="robot/camera",
        )
        return Sample("pair", stamp_ns, k, value, id=f"p{k}", frame="robot/camera")
