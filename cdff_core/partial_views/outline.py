# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Steps of the measured depth along the outline of a model in a range image."""

from __future__ import annotations

import math

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.partial_views.model_surface import ModelSurface
from cdff_core.partial_views.range_image import RangeImage

#: Distances of the pixels around the outline that are compared, pixels: pixels on the edge may mix depths.
_NEAR_PX, _FAR_PX = 2.0, 3.5


def outline_steps(
    image: RangeImage, surface: ModelSurface, T_view_model: FloatArray, spacing_m: float, tolerance_m: float
) -> float:
    """Return the fraction of the outline behind which the scene is deeper than the model.

    Outside the outline of an object the sensor measures its background, except where the object touches its
    support. If the measured surface continues instead, the model is part of a larger surface. Pixels in front
    of the model or without a measurement do not count; 0 without any other pixels.

    Parameters
    ----------
    image : RangeImage
    surface : ModelSurface
        Closed surface.
    T_view_model : ndarray, shape (4, 4)
        Pose of the surface in the frame of the view, metres.
    spacing_m : float
        Distance between points of the surface, metres.
    tolerance_m : float
        Smallest step of the depth, metres.
    """
    from scipy.ndimage import binary_closing, distance_transform_edt

    visible = surface.visible_from(-T_view_model[:3, :3].T @ T_view_model[:3, 3])
    points = se3.transform_points(T_view_model, surface.points_m[visible])
    points = points[points[:, 2] > 0.0]
    if not len(points):
        return 0.0
    column, row = np.floor((points[:, :2] / points[:, 2:] - image.low) / image.pixel).astype(np.int64).T
    holes_px = max(1, math.ceil(2.0 * spacing_m / float(np.median(points[:, 2])) / image.pixel))
    border = holes_px + math.ceil(_FAR_PX)
    first = np.array([row.min(), column.min()]) - border
    shape = np.array([row.max(), column.max()]) + border + 1 - first
    depth = np.full(shape, np.inf)
    np.minimum.at(depth, (row - first[0], column - first[1]), points[:, 2])
    silhouette = binary_closing(np.isfinite(depth), iterations=holes_px)
    distance_px = distance_transform_edt(~silhouette)
    around = np.stack(np.nonzero((distance_px > _NEAR_PX) & (distance_px <= _FAR_PX)))
    in_image = np.all((around.T + first >= 0) & (around.T + first < image.depth_m.shape), axis=1)
    around = around[:, in_image]
    nearest = distance_transform_edt(~np.isfinite(depth), return_distances=False, return_indices=True)
    model_m = depth[tuple(nearest[:, around[0], around[1]])]
    step_m = image.depth_m[tuple(around + first[:, None])] - model_m
    behind = int(np.count_nonzero((step_m > tolerance_m) & np.isfinite(step_m)))
    continued = int(np.count_nonzero(np.abs(step_m) <= tolerance_m))
    return behind / max(1, behind + continued)
