# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The grid that spreads features over the image, and the parameters that every detector on it shares."""

from __future__ import annotations

from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig


class GridConfig(DfnConfig):
    """Parameters of the grid."""

    features: Annotated[int, Field(ge=10, le=20_000)] = 800
    features_per_cell: Annotated[int, Field(ge=1, le=100)] = 8
    border_px: Annotated[int, Field(ge=1, le=200)] = 12


def checked_image(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The image as a contiguous array; raises InputError on anything but grey uint8."""
    if image.ndim != 2 or image.dtype != np.uint8 or min(image.shape) < 32:
        raise InputError(f"image {image.shape} {image.dtype}: expected (rows, cols) uint8, at least 32 x 32")
    return np.ascontiguousarray(image)


def strongest_of_each_cell(
    response: NDArray[np.float32], least: float, config: GridConfig
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Local maxima of a response, at most ``features_per_cell`` in a cell.

    Parameters
    ----------
    response : NDArray[np.float32], shape (rows, cols)
    least : float
        Responses up to this are no features.
    config : GridConfig

    Returns
    -------
    features : NDArray[np.float64], shape (n, 2)
        Column and row, pixels; by cell, the strongest first, ties by row and column.
    scores : NDArray[np.float64], shape (n,)
    """
    rows, columns = response.shape
    spacing = np.sqrt(rows * columns / config.features)
    side = 2 * max(1, int(spacing / 4.0)) + 1  # features keep half the mean spacing from each other
    b = config.border_px
    peak = (response == cv2.dilate(response, np.ones((side, side), np.uint8))) & (response > least)
    peak[:b], peak[rows - b :], peak[:, :b], peak[:, columns - b :] = False, False, False, False
    y, x = np.nonzero(peak)
    scores = response[y, x].astype(np.float64)
    cell = spacing * np.sqrt(config.features_per_cell)
    index = (y // cell).astype(np.int64) * (int(columns // cell) + 1) + (x // cell).astype(np.int64)
    order = np.lexsort((x, y, -scores, index))
    ordered = index[order]
    begins = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]]) if len(ordered) else np.zeros(0, np.int64)
    rank = np.arange(len(ordered)) - np.repeat(begins, np.diff(np.r_[begins, len(ordered)]))
    kept = order[rank < config.features_per_cell]
    return np.column_stack([x[kept], y[kept]]).astype(np.float64), scores[kept]
