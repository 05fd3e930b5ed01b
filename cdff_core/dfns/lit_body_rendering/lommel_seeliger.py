# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rendering with the reflection of Lommel and Seeliger and cast shadows."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.lit_body_rendering.interface import Inputs, Interface, Outputs
from cdff_core.object_models.lit_body import lit_body
from cdff_core.object_models.rendering import Window, body_window, render

#: Least size of the window of the body, px, and rendered light from which a pixel is lit.
_MIN_WINDOW, _LIT = 8, 0.05
#: Percentile of the lit pixels that has the same grey level in both images.
_BRIGHT = 90.0


class LommelSeeligerConfig(DfnConfig):
    """Parameters of LommelSeeliger."""

    point_spread_px: float = Field(
        0.7, gt=0, le=10, description="Standard deviation of the image of a point, px"
    )


class LommelSeeliger(Interface[LommelSeeligerConfig]):
    """Z-buffers from the camera and from the Sun. The dark level is the median of the image outside of the
    body, the bright one that of its brightest lit pixels.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the rendering; raises InputError."""
        if not len(inputs.triangles):
            raise InputError(f"{len(inputs.vertices)} vertices and no triangle, expected a mesh")
        norm = float(np.linalg.norm(inputs.sun))
        if norm == 0.0:
            raise InputError("sun: the direction is zero, expected a vector to the Sun")
        K, shape = inputs.camera_matrix, inputs.image.shape
        camera = Window(K[0, 0], K[1, 1], K[0, 2], K[1, 2], *shape)
        row, column, window = body_window(inputs.vertices, inputs.pose, camera)
        depth_m, light = np.full(shape, np.inf), np.zeros(shape, np.float32)
        if min(window.rows, window.columns) >= _MIN_WINDOW:
            part = np.s_[row : row + window.rows, column : column + window.columns]
            depth_m[part] = render(inputs.vertices, inputs.triangles, inputs.pose, window).depth_m
            light[part] = lit_body(
                inputs.vertices,
                inputs.triangles,
                inputs.pose,
                window,
                inputs.sun / norm,
                point_spread_px=self.config.point_spread_px,
                extent_px=float(max(window.rows, window.columns)),
            )
        is_body = np.isfinite(depth_m)
        rendering = _with_levels(light, inputs.image, is_body)
        return Outputs(
            rendering=rendering,
            depth=depth_m,
            lit_pixels=int(np.count_nonzero(is_body & (light > _LIT))),
            correlation=_correlation(rendering[is_body], inputs.image[is_body]),
        )


def _with_levels(light: Float32Array, image: np.ndarray, is_body: np.ndarray) -> np.ndarray:
    """Return the light (r, c) with the grey levels of an image (r, c) of uint8."""
    lit = is_body & (light > _LIT)
    if not lit.any():
        return np.zeros(light.shape, np.uint8)
    dark = 0.0 if is_body.all() else float(np.median(image[~is_body]))
    bright = float(np.percentile(image[lit], _BRIGHT)) - dark
    gain = max(bright, 1.0) / float(np.percentile(light[lit], _BRIGHT))
    return np.asarray(np.clip(np.rint(dark + gain * light), 0, 255), np.uint8)


def _correlation(first: np.ndarray, second: np.ndarray) -> float:
    a, b = (np.asarray(x, np.float64) - (float(np.mean(x)) if x.size else 0.0) for x in (first, second))
    norm: float = float(np.sqrt(np.sum(a * a) * np.sum(b * b)))
    return float(np.sum(a * b)) / norm if norm > 0.0 else float("nan")
