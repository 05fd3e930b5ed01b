# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One image with its registration, its regions and the camera that took it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.camera import CameraModel
from cdff_core.dfns.moving_region_detection.interface import MovingRegionDetectionOutputs
from cdff_core.dfns.scene_registration.interface import SceneRegistrationOutputs
from cdff_core.dfpcs.far_range_tracking.observer import Observer

#: Number of standard deviations of the motion of the surroundings that the depth of a point at rest may
#: explain.
_PARALLAX_SIGMAS = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One image and its analysis.

    Attributes
    ----------
    image : ndarray (r, c)
    observer : Observer
    regions : MovingRegionDetectionOutputs or None
        None if the image cannot be compared with the background.
    registration : SceneRegistrationOutputs or None
        Motion of the scene since the previous image; None without it.
    rotation_homography : ndarray (3, 3) or None
        Homography from the previous image due to the rotation of the camera alone.
    noise : float
        Standard deviation of the noise of a pixel.
    """

    stamp_ns: int
    image: np.ndarray
    camera: CameraModel
    observer: Observer
    regions: MovingRegionDetectionOutputs | None
    registration: SceneRegistrationOutputs | None
    rotation_homography: FloatArray | None
    noise: float

    def parallax_at(self, pixel: FloatArray) -> float:
        """Return the path since the previous image that the depth of a point at rest can explain, pixels.

        This path is the motion of the scene around the point due to the translation of the camera: an object
        at rest in front of the scene moves less than twice as fast.
        """
        if self.registration is None or self.registration.is_at_rest or self.rotation_homography is None:
            return 0.0
        rows, cols = self.registration.sigma.shape
        u, v = int(np.clip(pixel[0], 0, cols - 1)), int(np.clip(pixel[1], 0, rows - 1))
        by_rotation = np.linalg.solve(self.rotation_homography, np.array([u, v, 1.0]))
        motion = self.registration.places[v, u] - by_rotation[:2] / by_rotation[2]
        return float(np.linalg.norm(motion)) + _PARALLAX_SIGMAS * float(self.registration.sigma[v, u])

    @property
    def sizes(self) -> FloatArray:
        """Width and height of each region (n, 2)."""
        if self.regions is None:
            return np.zeros((0, 2))
        b = self.regions.boxes
        return np.maximum(np.column_stack([b[:, 1] - b[:, 0], b[:, 3] - b[:, 2]]), 1.0)


def boxes_around(boxes: FloatArray, position_px: FloatArray) -> BoolArray:
    """Return which boxes (n, 4), of first and last column and row, contain an image position (2,).

    A box or a position that is NaN contains nothing.
    """
    u, v = position_px
    is_around = (boxes[:, 0] <= u) & (u <= boxes[:, 1]) & (boxes[:, 2] <= v) & (v <= boxes[:, 3])
    return np.asarray(is_around, bool)
