# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Regions on grids: cell masks and coverage."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.region import Region
from cdff_common.raster.geometry import GridGeometry


def mask(region: Region, geometry: GridGeometry) -> NDArray[np.bool_]:
    """Return the cells ``(rows, cols)`` of a grid in the region's frame whose centre is inside."""
    return region.contains(geometry.x_centres_m()[None, :], geometry.y_centres_m()[:, None])


def coverage(region: Region, geometry: GridGeometry, observed: NDArray[np.bool_]) -> float:
    """Return the fraction 0 to 1 of the region's cells that are observed.

    Parameters
    ----------
    region : Region
    geometry : GridGeometry
        Grid in the region's frame. Cells of the region outside the grid count as unobserved; the number of
        cells is the area of the region divided by that of a cell.
    observed : NDArray[np.bool_], shape (rows, cols)
    """
    inside = mask(region, geometry)
    (x0, y0, x1, y1), g = region.bounds, geometry.bounds
    grid_contains_region = g.xmin <= x0 and g.ymin <= y0 and g.xmax >= x1 and g.ymax >= y1
    total = (
        float(np.count_nonzero(inside)) if grid_contains_region else region.area_m2 / geometry.resolution_m**2
    )
    observed_cells = float(np.count_nonzero(inside & observed))
    return min(observed_cells / total, 1.0) if total > 0.0 else 0.0
