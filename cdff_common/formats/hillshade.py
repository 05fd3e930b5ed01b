# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of maps for the eye: shaded relief of heights, colours of classes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cdff_common.formats.image import write_png
from cdff_common.raster.slope import hillshade

if TYPE_CHECKING:
    from cdff_common.types import ElevationMap, NavigationMap

_EXAGGERATION = 2.0


def hillshade_png(value: ElevationMap, *, largest: int | None = None) -> bytes:
    """PNG, grey with alpha as RGBA: relief lit from the north-west, transparent where unobserved.

    Parameters
    ----------
    value : ElevationMap
        Its layer ``mean`` is drawn, row 0 (ymax) on top.
    largest : int, optional
        Longest side of the picture, pixels; a bigger map is thinned to every n-th cell.
    """
    heights = np.asarray(value.layer("mean"), dtype=np.float64)
    step = 1 if largest is None else max(1, -(-max(heights.shape) // largest))
    thinned = heights[::step, ::step]
    shade = hillshade(thinned, value.geometry.resolution_m * step, exaggeration=_EXAGGERATION)
    alpha = np.where(np.isfinite(thinned), 255, 0).astype(np.uint8)
    return write_png(np.dstack([shade, shade, shade, alpha]))


def classes_png(value: NavigationMap, *, largest: int | None = None) -> bytes:
    """PNG of the classes: green safe, amber caution, red hazard, transparent unknown."""
    from cdff_common.raster.rendering import CLASS_COLORS

    classes = np.asarray(value.layer("class"))
    step = 1 if largest is None else max(1, -(-max(classes.shape) // largest))
    return write_png(CLASS_COLORS[np.minimum(classes[::step, ::step], 3).astype(np.intp)])
