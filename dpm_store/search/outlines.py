# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Exact geometry of a search: contact of boxes and footprints with a region, and distances from a point.

The outline of a product in the plane of the query is its footprint, else the convex hull of the corners of
its box. If the frames are tilted against each other, it is the convex hull of the footprint at both heights
of the box.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.region import Region

FloatArray = NDArray[np.float64]
#: Regions that compare only the sides of a box, without a rotation.
_AXIS_ALIGNED = ("bbox", "box", "circle")
_IDENTITY = np.eye(3)
_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=bool)


def corners_of(boxes_m: FloatArray) -> FloatArray:
    """Return the corners ``(n, 8, 3)`` of boxes ``(n, 6)``."""
    return np.where(_CORNERS[None], boxes_m[:, None, 3:], boxes_m[:, None, :3])


def touches(region: Region, boxes_m: FloatArray, T_region_boxes: FloatArray) -> NDArray[np.bool_]:
    """Return which boxes ``(n, 6)`` touch the region: outline in the plane, and height if the region has one.

    A rotated box touches if no axis of either box separates the two.
    """
    unrotated = bool((T_region_boxes[:3, :3] == _IDENTITY).all())
    if region.kind in _AXIS_ALIGNED and unrotated:  # the most frequent case
        low, high = boxes_m[:, :3] + T_region_boxes[:3, 3], boxes_m[:, 3:] + T_region_boxes[:3, 3]
    else:
        corners = corners_of(boxes_m) @ T_region_boxes[:3, :3].T + T_region_boxes[:3, 3]
        low, high = corners.min(axis=1), corners.max(axis=1)
    x0, y0, z0, x1, y1, z1 = region.box_m
    overlaps = (low[:, 0] <= x1) & (high[:, 0] >= x0) & (low[:, 1] <= y1) & (high[:, 1] >= y0)
    overlaps &= (low[:, 2] <= z1) & (high[:, 2] >= z0)
    aligned = unrotated or _is_aligned(T_region_boxes)
    if aligned and region.kind in ("bbox", "box"):
        return np.asarray(overlaps)
    if aligned and region.kind == "circle":
        cx, cy, r = region.values
        return np.asarray(overlaps & (_distance_to_boxes(low, high, (cx, cy)) <= r))
    if region.kind == "box":  # also compare along the axes of the boxes
        region_corners = (corners_of(np.array([region.box_m]))[0] - T_region_boxes[:3, 3]) @ T_region_boxes[
            :3, :3
        ]
        overlaps &= (boxes_m[:, :3] <= region_corners.max(axis=0)).all(axis=1) & (
            boxes_m[:, 3:] >= region_corners.min(axis=0)
        ).all(axis=1)
    indices = np.flatnonzero(overlaps)
    if len(indices) and aligned:
        import shapely

        boxes = shapely.box(low[indices, 0], low[indices, 1], high[indices, 0], high[indices, 1])
        overlaps[indices] = _touching(region, boxes)
    elif len(indices):
        overlaps[indices] = _touching(region, _hulls(corners[indices, :, :2]))
    return np.asarray(overlaps)


def contains(region: Region, boxes_m: FloatArray, T_region_boxes: FloatArray) -> NDArray[np.bool_]:
    """Return which boxes ``(n, 6)`` are entirely in the region, by bounds in its frame.

    False for some that are inside, and for all in a circle or near a path.
    """
    corners = corners_of(boxes_m) @ T_region_boxes[:3, :3].T + T_region_boxes[:3, 3]
    low, high = corners.min(axis=1), corners.max(axis=1)
    x0, y0, z0, x1, y1, z1 = region.box_m
    inside = (low >= [x0, y0, z0]).all(axis=1) & (high <= [x1, y1, z1]).all(axis=1)
    if region.kind in ("bbox", "box"):
        return np.asarray(inside)
    if region.kind != "polygon":
        return np.zeros(len(boxes_m), dtype=np.bool_)
    import shapely

    polygon = shapely.Polygon(region.corners)
    shapely.prepare(polygon)
    boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    return np.asarray(shapely.contains(polygon, boxes), dtype=np.bool_)


def footprints_touch(
    region: Region, rings: Sequence[FloatArray], heights_m: FloatArray, T_region_rings: FloatArray
) -> NDArray[np.bool_]:
    """Return which footprints touch the region in the plane.

    Parameters
    ----------
    rings : sequence of NDArray (k, 2)
        Rings in their frame, metres, not closed.
    heights_m : NDArray (n, 2)
        Lowest and highest z.
    """
    return _touching(region, _polygons(rings, heights_m, T_region_rings))


def distances_m(point: tuple[float, float], boxes_m: FloatArray, T_point_boxes: FloatArray) -> FloatArray:
    """Return the distances ``(n,)`` in the plane from a point to the outlines of boxes; 0 inside."""
    corners = corners_of(boxes_m) @ T_point_boxes[:3, :3].T + T_point_boxes[:3, 3]
    if _is_aligned(T_point_boxes):
        return _distance_to_boxes(corners.min(axis=1), corners.max(axis=1), point)
    import shapely

    return np.asarray(shapely.distance(_hulls(corners[:, :, :2]), shapely.Point(point)), dtype=np.float64)


def footprint_distances_m(
    point: tuple[float, float], rings: Sequence[FloatArray], heights_m: FloatArray, T_point_rings: FloatArray
) -> FloatArray:
    """Return ``distances_m`` to footprints."""
    import shapely

    polygons = _polygons(rings, heights_m, T_point_rings)
    return np.asarray(shapely.distance(polygons, shapely.Point(point)), dtype=np.float64)


def _is_aligned(T: FloatArray) -> bool:
    """Return whether axes stay parallel to axes."""
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
    """Return the outlines of footprints between two heights, seen from above in another frame."""
    import shapely

    level = abs(abs(T[2, 2]) - 1.0) < 1e-12
    lengths = np.array([len(ring) for ring in rings])
    indices = np.repeat(np.arange(len(rings)), lengths)
    xy = np.concatenate(rings)
    layers = [
        np.column_stack([xy, np.asarray(heights_m)[indices, side]]) @ T[:3, :3].T + T[:3, 3]
        for side in ((0,) if level else (0, 1))
    ]
    if level:
        return shapely.polygons(shapely.linearrings(layers[0][:, :2], indices=indices))
    corners = np.concatenate(layers)[:, :2]
    order = np.argsort(np.tile(indices, 2), kind="stable")
    return shapely.convex_hull(shapely.multipoints(corners[order], indices=np.repeat(indices, 2)))


def _touching(region: Region, outlines: Any) -> NDArray[np.bool_]:
    """Return which outlines intersect the region."""
    import shapely

    if region.kind == "circle":
        cx, cy, r = region.values
        return np.asarray(shapely.distance(outlines, shapely.Point(cx, cy)) <= r, dtype=np.bool_)
    if region.kind == "path":
        line = shapely.LineString(region.corners)
        return np.asarray(shapely.distance(outlines, line) <= region.values[0], dtype=np.bool_)
    polygon = shapely.Polygon(region.corners)
    shapely.prepare(polygon)
    return np.asarray(shapely.intersects(polygon, outlines), dtype=np.bool_)
