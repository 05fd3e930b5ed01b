# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Exact geometry of a search: do boxes and footprints touch a region, and how far are they from a point.

A product's outline in the plane of the question is its footprint where it has one, else the convex hull of its box's
corners; seen from a frame that is tilted against its own, the convex hull of the footprint at the box's two heights.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.region import Region

FloatArray = NDArray[np.float64]
#: Regions that compare a box's sides only, where neither is turned.
_UPRIGHT = ("bbox", "box", "circle")
_UNTURNED = np.eye(3)
_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=bool)


def corners_of(boxes_m: FloatArray) -> FloatArray:
    """Corners ``(n, 8, 3)`` of boxes ``(n, 6)``."""
    return np.where(_CORNERS[None], boxes_m[:, None, 3:], boxes_m[:, None, :3])


def touches(region: Region, boxes_m: FloatArray, T_region_boxes: FloatArray) -> NDArray[np.bool_]:
    """Tell which boxes ``(n, 6)`` touch the region: outline in the plane, and height where the region has one.

    Of a box in space, turned against the others, nothing separates them along an axis of either.
    """
    unturned = bool((T_region_boxes[:3, :3] == _UNTURNED).all())
    if region.kind in _UPRIGHT and unturned:  # most often by far
        low, high = boxes_m[:, :3] + T_region_boxes[:3, 3], boxes_m[:, 3:] + T_region_boxes[:3, 3]
    else:
        corners = corners_of(boxes_m) @ T_region_boxes[:3, :3].T + T_region_boxes[:3, 3]
        low, high = corners.min(axis=1), corners.max(axis=1)
    x0, y0, z0, x1, y1, z1 = region.box_m
    near = (low[:, 0] <= x1) & (high[:, 0] >= x0) & (low[:, 1] <= y1) & (high[:, 1] >= y0)
    near &= (low[:, 2] <= z1) & (high[:, 2] >= z0)
    aligned = unturned or _is_aligned(T_region_boxes)
    if aligned and region.kind in ("bbox", "box"):
        return np.asarray(near)
    if aligned and region.kind == "circle":
        cx, cy, r = region.values
        return np.asarray(near & (_distance_to_boxes(low, high, (cx, cy)) <= r))
    if region.kind == "box":  # and the other way round: the region, seen along the boxes' own axes
        seen = (corners_of(np.array([region.box_m]))[0] - T_region_boxes[:3, 3]) @ T_region_boxes[:3, :3]
        near &= (boxes_m[:, :3] <= seen.max(axis=0)).all(axis=1) & (boxes_m[:, 3:] >= seen.min(axis=0)).all(axis=1)
    indices = np.flatnonzero(near)
    if len(indices):
        near[indices] = _touching(region, _hulls(corners[indices, :, :2]))
    return np.asarray(near)


def footprints_touch(
    region: Region, rings: Sequence[FloatArray], heights_m: FloatArray, T_region_rings: FloatArray
) -> NDArray[np.bool_]:
    """Tell which footprints touch the region in the plane.

    Parameters
    ----------
    rings : sequence of NDArray (k, 2)
        In their frame, metres, not closed.
    heights_m : NDArray (n, 2)
        Lowest and highest z of each.
    """
    return _touching(region, _polygons(rings, heights_m, T_region_rings))


def distances_m(point: tuple[float, float], boxes_m: FloatArray, T_point_boxes: FloatArray) -> FloatArray:
    """Distance ``(n,)`` in the plane from a point to the outlines of boxes; 0 inside."""
    corners = corners_of(boxes_m) @ T_point_boxes[:3, :3].T + T_point_boxes[:3, 3]
    if _is_aligned(T_point_boxes):
        return _distance_to_boxes(corners.min(axis=1), corners.max(axis=1), point)
    import shapely

    return np.asarray(shapely.distance(_hulls(corners[:, :, :2]), shapely.Point(point)), dtype=np.float64)


def footprint_distances_m(
    point: tuple[float, float], rings: Sequence[FloatArray], heights_m: FloatArray, T_point_rings: FloatArray
) -> FloatArray:
    """As ``distances_m``, to footprints."""
    import shapely

    polygons = _polygons(rings, heights_m, T_point_rings)
    return np.asarray(shapely.distance(polygons, shapely.Point(point)), dtype=np.float64)


def _is_aligned(T: FloatArray) -> bool:
    """Whether boxes stay boxes: axes on axes."""
    return bool(np.array_equal(np.abs(T[:3, :3]).round(12), np.eye(3)))


def _distance_to_boxes(low: FloatArray, high: FloatArray, point: tuple[float, float]) -> FloatArray:
    dx = np.maximum(np.maximum(low[:, 0] - point[0], point[0] - high[:, 0]), 0.0)
    dy = np.maximum(np.maximum(low[:, 1] - point[1], point[1] - high[:, 1]), 0.0)
    return np.asarray(np.hypot(dx, dy))


def _hulls(corners_xy: FloatArray) -> Any:
    import shapely

    n, k = corners_xy.shape[:2]
    points = shapely.multipoints(corners_xy.reshape(-1, 2), indices=np.repeat(np.arange(n), k))
    return shapely.convex_hull(points)


def _polygons(rings: Sequence[FloatArray], heights_m: FloatArray, T: FloatArray) -> Any:
    import shapely

    level = abs(abs(T[2, 2]) - 1.0) < 1e-12
    found = []
    for ring, (low, high) in zip(rings, heights_m, strict=True):
        layers = [np.column_stack([ring, np.full(len(ring), z)]) for z in ((low,) if level else (low, high))]
        seen = np.concatenate(layers) @ T[:3, :3].T + T[:3, 3]
        outline = shapely.Polygon(seen[:, :2]) if level else shapely.convex_hull(shapely.MultiPoint(seen[:, :2]))
        found.append(outline)
    return np.array(found, dtype=object)


def _touching(region: Region, outlines: Any) -> NDArray[np.bool_]:
    import shapely

    if region.kind == "circle":
        cx, cy, r = region.values
        return np.asarray(shapely.distance(outlines, shapely.Point(cx, cy)) <= r, dtype=np.bool_)
    if region.kind == "path":
        line = shapely.LineString(region.corners)
        return np.asarray(shapely.distance(outlines, line) <= region.values[0], dtype=np.bool_)
    return np.asarray(shapely.intersects(outlines, shapely.Polygon(region.corners)), dtype=np.bool_)
