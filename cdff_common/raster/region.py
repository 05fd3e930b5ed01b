# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Regions over grids: which cells belong, and how many of them are observed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.region import Region
from cdff_common.raster.geometry import GridGeometry


def mask(region: Region, geometry: GridGeometry) -> NDArray[np.bool_]:
    """Cells ``(rows, cols)`` of a grid in the region's frame whose centre lies inside."""
    return region.contains(geometry.x_centres_m()[None, :], geometry.y_centres_m()[:, None])


def coverage(region: Region, geometry: GridGeometry, observed: NDArray[np.bool_]) -> float:
    """Share 0 to 1 of the region's cells that are observed.

    Parameters
    ----------
    region : Region
    geometry : GridGeometry
        A grid in the region's frame. Where it does not hold the whole region, the cells outside count as unobserved:
        their number is the region's area over a cell's.
    observed : NDArray[np.bool_], shape (rows, cols)
    """
    inside = mask(region, geometry)
    (x0, y0, x1, y1), g = region.bounds, geometry.bounds
    whole = g.xmin <= x0 and g.ymin <= y0 and g.xmax >= x1 and g.ymax >= y1
    total = float(np.count_nonzero(inside)) if whole else region.area_m2 / geometry.resolution_m**2
    hit = float(np.count_nonzero(inside & observed))
    return min(hit / total, 1.0) if total > 0.0 else 0.0
