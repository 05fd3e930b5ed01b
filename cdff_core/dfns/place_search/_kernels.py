# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled comparison of a scan with the heights of a map."""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray

#: Number of points after which a position with a mean above this fraction of the cut-off is rejected.
_GLANCE, _HOPELESS = 40, 0.6


@njit(cache=True)
def residuals(
    heights: FloatArray,
    origin: FloatArray,
    cell: float,
    starts: FloatArray,
    rotations: FloatArray,
    points: FloatArray,
    cutoff: float,
    least: float,
) -> FloatArray:  # pragma: no cover - compiled
    """Return the mean limited height difference of each start and rotation, shape (s, t); infinite for little
    coverage.

    Parameters
    ----------
    heights : ndarray, shape (rows, columns)
        Values of cells along x and y from ``origin (2,)``; NaN if unknown.
    starts : ndarray, shape (s, 4, 4)
        Poses of the ground below the robot.
    rotations : ndarray, shape (t, 2)
        Cosine and sine of rotations about the ground's normal.
    points : ndarray, shape (m, 3)
        About the foot of the robot, z along the ground's normal.
    """
    out = np.full((len(starts), len(rotations)), np.inf)
    rows, columns = heights.shape
    needed = least * len(points)
    for s in range(len(starts)):
        T = starts[s]
        for t in range(len(rotations)):
            c, w = rotations[t, 0], rotations[t, 1]
            total, count = 0.0, 0
            for i in range(len(points)):
                x = c * points[i, 0] - w * points[i, 1]
                y = w * points[i, 0] + c * points[i, 1]
                z = points[i, 2]
                row = int(np.floor((T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3] - origin[0]) / cell))
                column = int(np.floor((T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3] - origin[1]) / cell))
                if row < 0 or column < 0 or row >= rows or column >= columns:
                    continue
                height = heights[row, column]
                if np.isnan(height):
                    continue
                off = abs(T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3] - height)
                total += min(off, cutoff)
                count += 1
                if count == _GLANCE and total > _HOPELESS * cutoff * count:
                    count = 0
                    break
            if count >= needed and count > 0:
                out[s, t] = total / count
    return out
