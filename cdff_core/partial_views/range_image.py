# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Range image of a scene from the sensor at its origin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry.kdtree import kd_tree, spacing

#: Largest tangent of the angle between a point and the optical axis.
_MAX_TANGENT = 3.0
#: Edge of a pixel relative to the distance between points.
_PIXEL_SPACINGS = 1.5
#: A point belongs to a hidden surface if its depth exceeds that of the nearest point of the window around it
#: by more than this fraction.
_BEHIND = 0.05
#: Edge of the window around a point, pixels.
_WINDOW = 3
#: Minimum number of measured pixels among the 8 neighbours to interpolate the depth of an empty pixel.
_MIN_NEIGHBOURS = 4
#: Largest fraction of points of hidden surfaces in a single view.
_MAX_HIDDEN = 0.06
#: Largest number of pixels of a side: repeated points must not make the pixels arbitrarily small.
_MAX_SIDE = 2000


@dataclass(frozen=True, slots=True, eq=False)
class RangeImage:
    """Depths of a scene in a pinhole image; its optical axis is the mean direction of the points.

    Attributes
    ----------
    R_view_scene : ndarray, shape (3, 3)
        Rotation from the scene to the view, whose z axis is the optical axis. Both have their origin at the
        sensor.
    depth_m : ndarray, shape (rows, columns)
        Depths along the optical axis, metres; infinite for pixels without a point.
    low : ndarray, shape (2,)
        Tangents x / z and y / z of the corner of pixel (0, 0).
    pixel : float
        Edge of a pixel, as a tangent.
    spacing : float
        Distance between the points of the scene, as a tangent.
    """

    R_view_scene: FloatArray
    depth_m: FloatArray
    low: FloatArray
    pixel: float
    spacing: float


def range_image(points_m: FloatArray) -> RangeImage | None:
    """Return the range image of a scene ``(n, 3)``, metres; None if it is not one view from its origin."""
    from scipy.ndimage import minimum_filter

    distance = np.linalg.norm(points_m, axis=1)
    points_m = points_m[distance > 0.0]
    mean = np.mean(points_m / distance[distance > 0.0, None], axis=0)
    if np.linalg.norm(mean) < 0.3:
        return None
    z = mean / np.linalg.norm(mean)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.7 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    p = points_m @ R.T
    inside = (p[:, 2] > 0.0) & (np.abs(p[:, :2]).max(axis=1) < _MAX_TANGENT * p[:, 2])
    if np.mean(inside) < 0.99:
        return None
    p = p[inside]
    uv = p[:, :2] / p[:, 2:]
    step = spacing(kd_tree(np.column_stack([uv, np.zeros(len(uv))])))
    low = uv.min(axis=0)
    pixel = max(_PIXEL_SPACINGS * step, float(np.ptp(uv, axis=0).max()) / _MAX_SIDE)
    column, row = np.floor((uv - low) / pixel).astype(np.int64).T
    depth = np.full((row.max() + 1, column.max() + 1), np.inf)
    np.minimum.at(depth, (row, column), p[:, 2])
    nearest = minimum_filter(depth, _WINDOW)
    if np.mean(p[:, 2] > (1.0 + _BEHIND) * nearest[row, column]) > _MAX_HIDDEN:
        return None
    return RangeImage(R, _fill_gaps(depth), low, pixel, step)


def _fill_gaps(depth: FloatArray) -> FloatArray:
    """Return the image with empty pixels replaced by the median of enough measured neighbours."""
    padded = np.pad(np.where(np.isfinite(depth), depth, np.nan), 1, constant_values=np.nan)
    row, column = np.nonzero(~np.isfinite(depth))
    around = np.stack([padded[row + i, column + j] for i in range(3) for j in range(3) if (i, j) != (1, 1)])
    is_filled = np.count_nonzero(np.isfinite(around), axis=0) >= _MIN_NEIGHBOURS
    filled = depth.copy()
    filled[row[is_filled], column[is_filled]] = np.nanmedian(around[:, is_filled], axis=0)
    return filled
