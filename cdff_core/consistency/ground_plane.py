# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Plane of the ground in a cloud of a sensor whose orientation is not known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.se3 import FloatArray

#: Number of points of a cloud that are used, and number of triples of points that are tried.
_POINTS, _TRIPLES = 1200, 96
#: The surroundings of the robot contain this fraction of the points of a cloud, the nearest ones, up to the
#: greatest range, m.
_NEAR_FRACTION, _GREATEST_RADIUS_M = 0.7, 12.0
#: Distance of a point from its plane, as a fraction of the range of the point; least distance, metres.
_RELATIVE_DISTANCE, _LEAST_DISTANCE_M = 0.03, 0.05
#: Least fraction of the points on the plane, and least number of points.
_LEAST_FRACTION, _LEAST_POINTS = 0.35, 60
#: Cosine of the largest angle between a plane and the expected ground, and least ratio of its points to
#: those of the best plane, so that a wall or a ceiling with more points is not taken as ground.
_EXPECTED_COSINE, _EXPECTED_FRACTION = float(np.cos(np.radians(20.0))), 0.5


@dataclass(frozen=True, slots=True)
class GroundPlane:
    """Plane with the most points around the robot.

    Attributes
    ----------
    normal : ndarray, shape (3,)
        Unit normal from the plane towards the sensor, in the axes of the points.
    distance_m : float
        Distance of the sensor from the plane.
    fraction : float
        Fraction of the points on the plane.
    """

    normal: FloatArray
    distance_m: float
    fraction: float


def ground_plane(points_m: NDArray[np.floating], expected: FloatArray) -> GroundPlane | None:
    """Return the plane with the most points around a sensor at the origin; None if no plane has enough.

    A plane whose normal is near ``expected`` is preferred to one with up to twice its points, so that walls
    and ceilings do not replace a visible ground. The plane is found by random sampling with fixed numbers
    (Fischler and Bolles 1981, doi:10.1145/358669.358692) and fitted to its points by least squares.

    Parameters
    ----------
    points_m : ndarray, shape (n, 3)
        Points in axes parallel to those of ``expected``, relative to the sensor, metres.
    expected : ndarray, shape (3,)
        Unit normal of the ground if the mount of the sensor is right.
    """
    points = _surroundings(points_m)
    if len(points) < _LEAST_POINTS:
        return None
    range_m = np.linalg.norm(points, axis=1)
    limit_m = np.maximum(_RELATIVE_DISTANCE * range_m, _LEAST_DISTANCE_M)
    triples = points[(_uniform() * len(points)).astype(np.int64)]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    valid = lengths > 1e-6
    normals = normals[valid] / lengths[valid, None]
    offsets = np.einsum("ij,ij->i", normals, triples[valid, 0])
    normals, offsets = np.where(offsets[:, None] > 0.0, -normals, normals), -np.abs(offsets)
    counts = (np.abs(points @ normals.T - offsets) < limit_m[:, None]).sum(axis=0)
    if not len(counts):
        return None
    is_expected = normals @ expected > _EXPECTED_COSINE
    best = int(np.argmax(counts))
    if is_expected.any() and counts[is_expected].max() >= _EXPECTED_FRACTION * counts[best]:
        best = int(np.flatnonzero(is_expected)[np.argmax(counts[is_expected])])
    return _fit_plane(points, limit_m, normals[best], float(offsets[best]))


def _surroundings(points_m: NDArray[np.floating]) -> FloatArray:
    """Return at most ``_POINTS`` points near the sensor, evenly chosen."""
    step = max(1, len(points_m) // (4 * _POINTS))
    points: FloatArray = np.asarray(points_m[::step], dtype=np.float64)
    range_2 = np.einsum("ij,ij->i", points, points)
    usable = np.isfinite(range_2) & (range_2 > 0.0)
    points, range_2 = points[usable], range_2[usable]
    if not len(points):
        return np.zeros((0, 3))
    radius_2 = min(float(np.quantile(range_2, _NEAR_FRACTION)), _GREATEST_RADIUS_M**2)
    near_points: FloatArray = points[range_2 <= radius_2]
    return np.asarray(near_points[:: max(1, -(-len(near_points) // _POINTS))])


def _fit_plane(
    points: FloatArray, limit_m: FloatArray, normal: FloatArray, offset_m: float
) -> GroundPlane | None:
    """Fit a plane to the points within ``limit_m`` (n,) of an initial plane; None if they are too few.

    A point has the weight ``limit_m**-2``, since its error grows with its range.
    """
    for _ in range(2):
        inliers = np.abs(points @ normal - offset_m) < limit_m
        if np.count_nonzero(inliers) < _LEAST_POINTS:
            return None
        weights = 1.0 / limit_m[inliers] ** 2
        plane_points = points[inliers]
        mean = weights @ plane_points / weights.sum()
        scatter = ((plane_points - mean) * weights[:, None]).T @ (plane_points - mean)
        normal = np.linalg.eigh(scatter)[1][:, 0]
        offset_m = float(normal @ mean)
        if offset_m > 0.0:  # the normal points from the ground to the sensor, the origin
            normal, offset_m = -normal, -offset_m
    fraction = float(np.count_nonzero(np.abs(points @ normal - offset_m) < limit_m)) / len(points)
    return GroundPlane(normal, -offset_m, fraction) if fraction >= _LEAST_FRACTION else None


@cache
def _uniform() -> FloatArray:
    """Return the fixed random numbers ``(_TRIPLES, 3)`` that choose the triples."""
    return np.random.default_rng(19810601).random((_TRIPLES, 3))
