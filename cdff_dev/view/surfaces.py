# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps as surfaces of triangles."""

from __future__ import annotations

import numpy as np

from cdff_common.raster.rendering import CLASS_COLORS
from cdff_common.raster.slope import hillshade
from cdff_common.types import ElevationMap, NavigationMap
from cdff_dev.view.drawings import Surface, colours_of

#: Most vertices of a surface; larger maps are thinned evenly.
MAX_VERTICES = 120_000
#: Brightness of a slope in the shade.
_AMBIENT = 0.5


def surface_of_map(value: ElevationMap | NavigationMap) -> Surface:
    """Return a vertex at the centre of each known cell, and two triangles between four neighbours.

    The colours of an elevation map are its heights, shaded; those of a navigation map, drawn at height 0, its
    classes.
    """
    geometry = value.geometry
    step = max(1, int(np.ceil(np.sqrt(geometry.rows * geometry.cols / MAX_VERTICES))))
    if isinstance(value, ElevationMap):
        heights_m = np.asarray(value.layer("mean"), dtype=np.float64)[::step, ::step]
        shade = hillshade(heights_m, geometry.resolution_m * step) / 255.0
        brightness = _AMBIENT + (1.0 - _AMBIENT) * np.nan_to_num(shade, nan=1.0)
        colours = (colours_of(heights_m) * brightness[..., None]).astype(np.uint8)
        known = np.isfinite(heights_m)
    else:
        classes = np.minimum(value.layer("class"), 3).astype(np.intp)[::step, ::step]
        colours, heights_m = CLASS_COLORS[classes][..., :3], np.zeros(classes.shape)
        known = CLASS_COLORS[classes][..., 3] > 0
    rows, cols = heights_m.shape
    x_m = geometry.xmin_m + (np.arange(cols) * step + 0.5) * geometry.resolution_m
    y_m = geometry.ymax_m - (np.arange(rows) * step + 0.5) * geometry.resolution_m
    grid = np.dstack([*np.meshgrid(x_m, y_m), heights_m])
    numbers = np.cumsum(known.ravel()).reshape(known.shape) - 1
    is_complete = known[:-1, :-1] & known[:-1, 1:] & known[1:, :-1] & known[1:, 1:]
    a, b, c, d = (
        n[is_complete] for n in (numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, :-1], numbers[1:, 1:])
    )
    triangles = np.vstack([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    return Surface(grid[known].astype(np.float32), triangles.astype(np.uint32), colours[known])
