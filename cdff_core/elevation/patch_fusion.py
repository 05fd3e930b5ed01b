# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Grid windows of moving and tiled maps."""

from __future__ import annotations

from math import floor

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster import GridGeometry


def middle_of(geometry: GridGeometry) -> NDArray[np.float64]:
    """Return the centre (x, y) of a grid, metres."""
    b = geometry.bounds
    return np.array([0.5 * (b.xmin + b.xmax), 0.5 * (b.ymin + b.ymax)])


def bounds_of(bounds: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Return an array ``(4,)`` of xmin, ymin, xmax, ymax as a tuple."""
    xmin, ymin, xmax, ymax = (float(v) for v in bounds)
    return xmin, ymin, xmax, ymax


def window_around(frame: str, resolution_m: float, xy_m: NDArray[np.float64], size_m: float) -> GridGeometry:
    """Return the square grid, aligned with the cells of the frame, whose centre is nearest to a position."""
    cells = max(1, round(size_m / resolution_m))
    left = floor(xy_m[0] / resolution_m) - cells // 2
    top = floor(xy_m[1] / resolution_m) + 1 + (cells - 1) // 2
    return GridGeometry.from_cells(frame, resolution_m, left=left, top=top, rows=cells, cols=cells)
