# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Grid that distributes features over the image, and parameters of the detectors that use it."""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field

from cdff_common.arrays import BoolArray, Float32Array, FloatArray
from cdff_common.interfaces.dfn import DfnConfig

#: Maximum number of points in a cell; it determines the size of the cells for the desired number of points.
_FEATURES_PER_CELL = 8
#: Width of the image border that is excluded: patches of descriptors and trackers must lie in the image.
_BORDER_PX = 12


class GridConfig(DfnConfig):
    """Parameters of the grid of cells."""

    features: int = Field(800, ge=10, le=20_000, description="Desired number of points over the whole image")


def select_strongest_per_cell(
    response: Float32Array, threshold: float, config: GridConfig, mask: BoolArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the local maxima of a response, in each cell at most the 8 strongest.

    Parameters
    ----------
    response : Float32Array, shape (rows, cols)
    threshold : float
        Features have a response above this.
    config : GridConfig
    mask : BoolArray, shape (rows, cols), optional
        True for pixels at which features may be detected. Other pixels are ignored: they do not suppress
        features near them.

    Returns
    -------
    features : FloatArray, shape (n, 2)
        Column and row, pixels; by cell, the strongest first, ties by row and column.
    scores : FloatArray, shape (n,)
    """
    rows, columns = response.shape
    if mask is not None:
        response = np.where(mask, response, np.float32(-np.inf))
    mean_spacing_px = np.sqrt(rows * columns / config.features)
    # Maxima are more than a quarter of the mean spacing apart.
    window_px = 2 * max(1, int(mean_spacing_px / 4.0)) + 1
    local_maximum = cv2.dilate(response, np.ones((window_px, window_px), np.uint8))
    inner = np.zeros(response.shape, bool)
    inner[_BORDER_PX : rows - _BORDER_PX, _BORDER_PX : columns - _BORDER_PX] = True
    y, x = np.nonzero(inner & (response == local_maximum) & (response > threshold))
    scores = response[y, x].astype(np.float64)
    cell_px = mean_spacing_px * np.sqrt(_FEATURES_PER_CELL)
    cell = (y // cell_px).astype(np.int64) * (int(columns // cell_px) + 1) + (x // cell_px).astype(np.int64)
    order = np.lexsort((x, y, -scores, cell))
    # Rank of each feature within its cell, from the position at which the cell starts in the order.
    _, cell_start, cell_size = np.unique(cell[order], return_index=True, return_counts=True)
    rank = np.arange(len(order)) - np.repeat(cell_start, cell_size)
    strongest_rows = order[rank < _FEATURES_PER_CELL]
    return np.column_stack([x[strongest_rows], y[strongest_rows]]).astype(np.float64), scores[strongest_rows]
