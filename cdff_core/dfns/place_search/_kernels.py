# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled comparison of a scan with the heights of a map."""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray
from cdff_common.geometry.small_vectors import transformed

#: After this number of points, a pose is rejected if the mean difference exceeds this fraction of the
#: cut-off.
_EARLY_POINTS, _EARLY_LIMIT = 40, 0.6


@njit(cache=True)
def residuals(
    heights: FloatArray,
    origin: FloatArray,
    cell: float,
    starts: FloatArray,
    rotations: FloatArray,
    points: FloatArray,
    cutoff: float,
    min_covered: float,
) -> FloatArray:  # pragma: no cover - compiled
    """Return the mean height difference, limited to ``cutoff``, at each start pose and rotation, shape (s,
    t); infinite if less than the fraction ``min_covered`` of the points lies on known cells.

    Parameters
    ----------
    heights : ndarray, shape (rows, columns)
        Heights of the cells along x and y, the first at ``origin (2,)``; NaN if unknown.
    starts : ndarray, shape (s, 4, 4)
        ``T_map_foot``: poses of the ground below the robot.
    rotations : ndarray, shape (t, 2)
        Cosine and sine of rotations about the ground's normal.
    points : ndarray, shape (m, 3)
        Points in the frame of the foot: origin on the ground below the robot, z along the normal of the
        ground.
    """
    out = np.full((len(starts), len(rotations)), np.inf)
    rows, columns = heights.shape
    min_count = min_covered * len(points)
    for s in range(len(starts)):
        T_map_foot = starts[s]
        for t in range(len(rotations)):
            cosine, sine = rotations[t, 0], rotations[t, 1]
            total, count = 0.0, 0
            for i in range(len(points)):
                x = cosine * points[i, 0] - sine * points[i, 1]
                y = sine * points[i, 0] + cosine * points[i, 1]
                map_x, map_y, map_z = transformed(T_map_foot, x, y, points[i, 2])
                row = int(np.floor((map_x - origin[0]) / cell))
                column = int(np.floor((map_y - origin[1]) / cell))
                if row < 0 or column < 0 or row >= rows or column >= columns:
                    continue
                height = heights[row, column]
                if np.isnan(height):
                    continue
                difference = abs(map_z - height)
                total += min(difference, cutoff)
                count += 1
                if count == _EARLY_POINTS and total > _EARLY_LIMIT * cutoff * count:
                    count = 0
                    break
            if count >= min_count and count > 0:
                out[s, t] = total / count
    return out
