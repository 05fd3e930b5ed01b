# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of maps for display: shaded relief of heights, colours of classes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cdff_common.formats.image import write_png
from cdff_common.raster.slope import hillshade

if TYPE_CHECKING:
    from cdff_common.types import ElevationMap, NavigationMap

#: Factor on heights, so that flat terrain shows relief.
_EXAGGERATION = 2.0


def hillshade_png(value: ElevationMap) -> bytes:
    """Return a PNG (RGBA) of the relief, illuminated from the north-west, transparent where unobserved.

    Parameters
    ----------
    value : ElevationMap
        Its layer ``mean`` is drawn, row 0 (ymax) on top.
    """
    heights = np.asarray(value.layer("mean"), dtype=np.float64)
    shade = hillshade(heights, value.geometry.resolution_m, exaggeration=_EXAGGERATION)
    alpha = np.where(np.isfinite(heights), 255, 0).astype(np.uint8)
    return write_png(np.dstack([shade, shade, shade, alpha]))


def classes_png(value: NavigationMap) -> bytes:
    """Return a PNG of the classes: green safe, amber caution, red hazard, transparent unknown."""
    from cdff_common.raster.rendering import CLASS_COLORS

    return write_png(CLASS_COLORS[np.minimum(value.layer("class"), 3).astype(np.intp)])
