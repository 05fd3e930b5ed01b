# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of the report of a mission in orbit: delivered images, and views of the delivered model."""

from __future__ import annotations

import base64

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import Frame
from cdff_dev.missions.orbit.comparison import ModelErrors
from cdff_dev.missions.orbit.ray_scene import RaySurface

#: Width and height of a view, pixels, and distance whose colour is red, metres.
_VIEW_PX, _RED_M = 420, 0.1
#: Directions from which the model is seen, in the frame of the body.
_DIRECTIONS = ((1.0, 0.6, 0.4), (-1.0, -0.6, 0.4), (0.3, 0.2, -1.0))


def image_uri(frame: Frame) -> str:
    """Return an image as a data URI, with the brightest percentile white."""
    image = np.asarray(frame.image, dtype=np.float64)
    low, high = np.percentile(image, [1.0, 99.9])
    grey = np.clip(255.0 * (image - low) / max(high - low, 1.0), 0.0, 255.0).astype(np.uint8)
    return _png_uri(grey)


def model_views(model: ModelErrors) -> list[str]:
    """Return shaded views of a model as data URIs; the colour is the distance from the true surface."""
    return [_png_uri(_view(model, np.array(direction))) for direction in _DIRECTIONS]


def _view(model: ModelErrors, direction: FloatArray) -> NDArray[np.uint8]:
    """Return a parallel projection (rows, columns, 3) of the model, in the order blue, green, red."""
    vertices, triangles = model.model.data.vertices, model.model.data.triangles
    centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius_m = float(np.linalg.norm(vertices - centre, axis=1).max())
    z = -direction / np.linalg.norm(direction)
    x = np.cross(z, [0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    steps = np.linspace(-radius_m, radius_m, _VIEW_PX)
    u, v = np.meshgrid(steps, steps)
    origins = centre - 2.0 * radius_m * z + u[..., None] * x + v[..., None] * y
    parameters, row, normals = RaySurface(vertices, triangles).cast(origins, z)
    error_m = model.distances_m[triangles[row]].mean(axis=2)
    shade = 0.25 + 0.75 * np.abs(normals @ z)
    red = np.clip(error_m / _RED_M, 0.0, 1.0)
    colour = np.stack([0.9 * (1.0 - red), 0.9 * (1.0 - red), 0.6 + 0.4 * red], axis=2)
    picture = np.where(np.isfinite(parameters)[..., None], 255.0 * shade[..., None] * colour, 30.0)
    return np.asarray(picture, dtype=np.uint8)


def _png_uri(image: NDArray[np.uint8]) -> str:
    _, encoded = cv2.imencode(".png", image)
    return "data:image/png;base64," + base64.b64encode(encoded.tobytes()).decode()
