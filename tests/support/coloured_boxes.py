# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Colour images of a box with colour noise in front of a background of other colours."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_core.object_models.rendering import Window, render
from tests.support import satellite
from tests.support.satellite_images import CAMERA_MATRIX, COLUMNS, ROWS

BOX = satellite.box((1.0, 0.8, 0.6))
T_BOX = se3.transform(se3.exp_so3([0.4, 0.5, 0.1]), [0.0, 0.0, 4.0])
_BODY, _BACKGROUND = np.array([170.0, 120.0, 60.0]), np.array([90.0, 110.0, 150.0])


def colour_image(T: np.ndarray, rng: np.random.Generator, noise: float = 25.0) -> np.ndarray:
    """Return an image (240, 320, 3) of uint8 of the box at T_camera_box."""
    K = CAMERA_MATRIX
    face = render(*BOX, T, Window(K[0, 0], K[1, 1], K[0, 2], K[1, 2], ROWS, COLUMNS)).face
    image = np.where(face[..., None] >= 0, _BODY, _BACKGROUND)
    return np.asarray(np.clip(image + rng.normal(0.0, noise, image.shape), 0, 255), np.uint8)
