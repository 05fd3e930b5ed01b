# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Contour lines of an elevation grid (marching squares of contourpy); they end at unobserved cells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry

Float = NDArray[np.float64]

#: Largest number of levels, and of corners of all lines.
MAX_LEVELS, MAX_CORNERS = 1000, 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Contour:
    """Lines of one height.

    Attributes
    ----------
    height_m : float
    lines_m : tuple of Float, shape (n, 2)
        Corners in the frame of the grid, metres; a closed line repeats its first corner. Higher ground is on
        the left.
    """

    height_m: float
    lines_m: tuple[Float, ...]


def contours(geometry: GridGeometry, heights_m: ArrayLike, interval_m: float) -> Iterator[Contour]:
    """Yield the contours at the multiples of an interval, from low to high.

    Raises
    ------
    InputError
        If there are more than ``MAX_LEVELS`` levels or ``MAX_CORNERS`` corners.
    """
    from contourpy import LineType, contour_generator

    z = np.ascontiguousarray(heights_m, dtype=np.float64)
    known = np.isfinite(z)
    if not known.any() or min(z.shape) < 2:
        return
    first, last = int(np.ceil(z[known].min() / interval_m)), int(np.floor(z[known].max() / interval_m))
    if last - first + 1 > MAX_LEVELS:
        raise InputError(
            f"interval_m={interval_m:g}: {last - first + 1} contours, expected at most {MAX_LEVELS}; ask for "
            "a larger interval"
        )
    generator = contour_generator(
        geometry.x_centres_m(),
        geometry.y_centres_m()[::-1],
        np.ma.masked_invalid(z[::-1]),
        line_type=LineType.Separate,
    )
    corners = 0
    for level in range(first, last + 1):
        lines = tuple(np.asarray(line) for line in generator.lines(level * interval_m))
        corners += sum(len(line) for line in lines)
        if corners > MAX_CORNERS:
            raise InputError(
                f"contours of more than {MAX_CORNERS} corners: ask for a smaller region, a larger interval_m "
                "or a larger resolution_m"
            )
        if lines:
            yield Contour(level * interval_m, lines)
