# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A scan as an image from its sensor: directions and depths of the points, and which pixels were hit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.errors import RefusedError
from cdff_common.geometry.kdtree import kd_tree, neighbours
from cdff_core.object_models.rendering import Window
from cdff_core.object_models.views import view_rotation

#: Largest number of pixels of a side of the image.
_MAX_SIDE = 160
#: Pixels of a spacing, as far as ``_MAX_SIDE`` permits: rays do not meet the centres of pixels.
_OVERSAMPLING = 3.0
#: Half the edge of the square around a measured direction, in spacings. The squares around a grid of
#: directions at any angle leave no gaps above 0.71.
_HIT_RADIUS = 0.75
#: Largest tangent of the angle between a point and the optical axis.
_MAX_TANGENT = 2.0
#: Number of points from which the spacing of a scan is measured.
_SPACING_SAMPLE = 1000


class ScanView(NamedTuple):
    """Points of a scan in a pinhole image with the sensor at its origin.

    Attributes
    ----------
    R_view_sensor : ndarray, shape (3, 3)
        The optical axis is the mean direction of the points.
    points_m : ndarray, shape (n, 3)
        Points in the view; the third coordinate is the depth.
    tangents : ndarray, shape (n, 2)
        x / z and y / z.
    pixels : ndarray of int64, shape (n, 2)
        Row and column of each point.
    hit : ndarray of bool, shape (rows, columns)
        Pixels with a measurement in their neighbourhood.
    window : Window
    spacing : float
        Distance of neighbouring directions, as a tangent.
    """

    R_view_sensor: FloatArray
    points_m: FloatArray
    tangents: FloatArray
    pixels: IntArray
    hit: BoolArray
    window: Window
    spacing: float


def scan_view(points_m: FloatArray, diameter_m: float) -> ScanView:
    """Return the view of finite points (n, 3) from the origin, with space for a model of ``diameter_m``.

    Raises
    ------
    RefusedError
        ``sensor_inside`` if the points surround the sensor.
    """
    ranges = np.linalg.norm(points_m, axis=1)
    axis = np.median(points_m / np.maximum(ranges, 1e-12)[:, None], axis=0)
    if np.linalg.norm(axis) < 0.3:
        raise RefusedError("the points surround the sensor", ("sensor_inside",))
    R = view_rotation(-axis)
    p = points_m @ R.T
    p = p[(p[:, 2] > 0.0) & (np.abs(p[:, :2]).max(axis=1) < _MAX_TANGENT * p[:, 2])]
    if len(p) < 3:
        raise RefusedError("the points surround the sensor", ("sensor_inside",))
    tangents = p[:, :2] / p[:, 2:]
    step = _spacing(tangents)
    margin = 0.5 * diameter_m / float(np.median(p[:, 2]))
    low, high = tangents.min(axis=0) - margin, tangents.max(axis=0) + margin
    pixel = max(step / _OVERSAMPLING, float((high - low).max()) / _MAX_SIDE)
    columns, rows = (np.ceil((high - low) / pixel).astype(np.int64) + 1).tolist()
    window = Window(1.0 / pixel, 1.0 / pixel, -low[0] / pixel, -low[1] / pixel, rows, columns)
    position = (tangents - low) / pixel
    place = np.rint(position).astype(np.int64)
    hit = np.zeros((rows, columns), bool)
    reach = max(_HIT_RADIUS * step / pixel, 0.5)
    first = np.maximum(np.ceil(position - reach), 0).astype(np.int64)
    last = np.minimum(np.floor(position + reach), [columns - 1, rows - 1]).astype(np.int64)
    for i in range(int((last - first).max()) + 1):
        for j in range(int((last - first).max()) + 1):
            cell = np.minimum(first + np.array([i, j]), last)
            hit[cell[:, 1], cell[:, 0]] = True
    return ScanView(
        R, np.ascontiguousarray(p), tangents, place[:, ::-1].copy(), hit, window, max(step, pixel)
    )


def _spacing(tangents: FloatArray) -> float:
    """Return the distance of neighbouring directions (n, 2) in the direction in which it is larger.

    A point of a grid has two neighbours in each direction: the third one counts, also along the outline.
    """
    flat = np.column_stack([tangents, np.zeros(len(tangents))])
    step = max(1, len(flat) // _SPACING_SAMPLE)
    distance, _ = neighbours(kd_tree(flat), flat[::step], min(4, len(flat)))
    return max(float(np.median(distance[:, -1])), 1e-9)
