# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Grid that distributes features over the image, and parameters of the detectors that use it."""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.interfaces.dfn import DfnConfig

#: Maximum number of points of a cell, whose size follows from the desired number of points.
_FEATURES_PER_CELL = 8
#: Width of the image border that is excluded: patches of descriptors and trackers must lie in the image.
_BORDER_PX = 12


class GridConfig(DfnConfig):
    """Parameters of the grid."""

    features: int = Field(800, ge=10, le=20_000, description="Desired number of points over the whole image")


def strongest_of_each_cell(
    response: Float32Array, least: float, config: GridConfig
) -> tuple[FloatArray, FloatArray]:
    """Return the local maxima of a response, at most 8 in a cell.

    Parameters
    ----------
    response : Float32Array, shape (rows, cols)
    least : float
        Largest response that is not a feature.
    config : GridConfig

    Returns
    -------
    features : FloatArray, shape (n, 2)
        Column and row, pixels; by cell, the strongest first, ties by row and column.
    scores : FloatArray, shape (n,)
    """
    rows, columns = response.shape
    spacing = np.sqrt(rows * columns / config.features)
    side = 2 * max(1, int(spacing / 4.0)) + 1  # features are at least half the mean spacing apart
    b = _BORDER_PX
    peak = (response == cv2.dilate(response, np.ones((side, side), np.uint8))) & (response > least)
    peak[:b], peak[rows - b :], peak[:, :b], peak[:, columns - b :] = False, False, False, False
    y, x = np.nonzero(peak)
    scores = response[y, x].astype(np.float64)
    cell = spacing * np.sqrt(_FEATURES_PER_CELL)
    index = (y // cell).astype(np.int64) * (int(columns // cell) + 1) + (x // cell).astype(np.int64)
    order = np.lexsort((x, y, -scores, index))
    ordered = index[order]
    begins = (
        np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]]) if len(ordered) else np.zeros(0, np.int64)
    )
    rank = np.arange(len(ordered)) - np.repeat(begins, np.diff(np.r_[begins, len(ordered)]))
    kept = order[rank < _FEATURES_PER_CELL]
    return np.column_stack([x[kept], y[kept]]).astype(np.float64), scores[kept]
