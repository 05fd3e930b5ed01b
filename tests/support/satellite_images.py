# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Shaded images of a body before a dark background."""

from __future__ import annotations

import cv2
import numpy as np

from cdff_core.object_models.rendering import Window, camera_normals, render
from tests.support.satellite import Mesh

CAMERA_MATRIX = np.array([[400.0, 0.0, 159.5], [0.0, 400.0, 119.5], [0.0, 0.0, 1.0]])
ROWS, COLUMNS = 240, 320
_LIGHT = np.array([0.4, -0.5, -0.77])
#: Pixels are averages of this number of samples along rows and columns.
_SAMPLES = 3


def image_of(mesh: Mesh, T: np.ndarray, rng: np.random.Generator, noise: float = 2.0) -> np.ndarray:
    """Return a grey image (240, 320) of uint8 with each face shaded by its angle to a light."""
    vertices, triangles = mesh
    K, n = CAMERA_MATRIX, _SAMPLES
    middle = n * K[:2, 2] + 0.5 * (n - 1)
    window = Window(n * K[0, 0], n * K[1, 1], middle[0], middle[1], n * ROWS, n * COLUMNS)
    face = render(vertices, triangles, T, window).face
    cosine = camera_normals(vertices, triangles, T, face) @ _LIGHT
    fine = np.where(face >= 0, 60.0 + 160.0 * np.clip(np.nan_to_num(cosine), 0.0, 1.0), 10.0)
    image = fine.reshape(ROWS, n, COLUMNS, n).mean(axis=(1, 3)) + rng.normal(0.0, noise, (ROWS, COLUMNS))
    return np.asarray(np.clip(cv2.GaussianBlur(image, (0, 0), 0.6), 0, 255), np.uint8)
