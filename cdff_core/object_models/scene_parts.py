# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parts of a depth image that can be an object: without large planes, separated by steps of the depth."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray, IntArray

#: Largest number of planes that are removed, least fraction of the points on such a plane, and its least
#: extent, in diameters of the object: a smaller plane may be a face of the object.
_MAX_PLANES, _MIN_FRACTION, _MIN_EXTENT = 6, 0.03, 1.5
#: Number of trials and of points of the search for a plane, and rounds of its refinement.
_TRIALS, _SAMPLE, _ROUNDS = 200, 2000, 3
#: Distance from a plane up to which a point belongs to the plane: in diameters of the object, and per metre
#: of depth.
_THICKNESS, _THICKNESS_PER_M = 0.06, 0.012
#: Least number of points of a region of a plane that is removed.
_MIN_REGION = 30
#: Distance up to which points belong to the same part: in diameters of the object, and in spacings of the
#: pixels.
_LINK, _LINK_SPACINGS = 0.1, 4.0
#: Smallest and largest extent of a part, in diameters of the object.
_SMALLEST, _LARGEST = 0.3, 1.6


class SceneParts(NamedTuple):
    """Parts of a depth image.

    Attributes
    ----------
    parts : list of ndarray, shape (n,)
        Indices into the flat image of each part that can be an object, the largest part first.
    on_planes : ndarray of bool, shape (r, c)
        Points on planes that are larger than the object.
    """

    parts: list[IntArray]
    on_planes: BoolArray


def scene_parts(points_m: FloatArray, diameter_m: float, min_points: int, *, seed: int = 0) -> SceneParts:
    """Return the parts that can be an object.

    Parameters
    ----------
    points_m : ndarray, shape (r, c, 3)
        Points of a depth image; NaN without a measurement.
    diameter_m : float
        That of the object.
    min_points : int
    seed : int
        Seed of the search for planes.
    """
    is_point: BoolArray = np.asarray(np.isfinite(points_m).all(axis=-1))
    on_planes = _on_large_planes(points_m, is_point, diameter_m, seed)
    labels = _components(points_m, is_point & ~on_planes, _LINK * diameter_m)
    order = np.argsort(labels, kind="stable")
    starts = np.searchsorted(labels[order], np.arange(labels.max(initial=0) + 2))
    flat = points_m.reshape(-1, 3)
    parts = []
    for first, last in pairwise(starts):
        rows = order[first:last]
        if len(rows) < min_points:
            continue
        low, high = np.quantile(flat[rows], [0.02, 0.98], axis=0)
        if _SMALLEST * diameter_m <= float(np.linalg.norm(high - low)) <= _LARGEST * diameter_m:
            parts.append(rows)
    return SceneParts(sorted(parts, key=len, reverse=True), on_planes)


def _on_large_planes(points_m: FloatArray, is_point: BoolArray, diameter_m: float, seed: int) -> BoolArray:
    """Return the mask (r, c) of points on planes that are larger than the object."""
    rng = np.random.default_rng(seed)
    removed, examined = np.zeros(is_point.shape, bool), ~is_point
    total = np.count_nonzero(is_point)
    for _ in range(_MAX_PLANES):
        left = ~examined
        points = points_m[left]
        if len(points) < max(_MIN_FRACTION * total, 10):
            break
        normal, offset = _plane(points, diameter_m, rng)
        on_plane = np.zeros_like(removed)
        on_plane[left] = np.abs(points @ normal - offset) < _thickness(points, diameter_m)
        # A plane also cuts objects elsewhere: those small regions stay.
        removed |= _large_regions(on_plane, points_m, _MIN_EXTENT * diameter_m)
        examined |= on_plane
    return removed


def _large_regions(mask: BoolArray, points_m: FloatArray, least_m: float) -> BoolArray:
    """Return the connected regions of a mask (r, c) whose points extend over at least ``least_m``."""
    from scipy.ndimage import find_objects, label

    labels, _ = label(mask, np.ones((3, 3)))
    large = np.zeros(mask.shape, bool)
    for number, box in enumerate(find_objects(labels), start=1):
        inside = labels[box] == number
        if np.count_nonzero(inside) >= _MIN_REGION:
            extent_m = np.linalg.norm(np.ptp(points_m[box][inside], axis=0))
            large[box] |= inside & (extent_m >= least_m)
    return large


def _thickness(points_m: FloatArray, diameter_m: float) -> FloatArray:
    return np.asarray(np.minimum(_THICKNESS * diameter_m, _THICKNESS_PER_M * points_m[:, 2]))


def _plane(points_m: FloatArray, diameter_m: float, rng: np.random.Generator) -> tuple[FloatArray, float]:
    """Return normal (3,) and offset of the plane with the most points (n, 3)."""
    sample = points_m[rng.permutation(len(points_m))[:_SAMPLE]]
    a, b, c = (sample[rng.integers(0, len(sample), _TRIALS)] for _ in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    normals, a = normals[length > 0.0] / length[length > 0.0, None], a[length > 0.0]
    if not len(normals):
        return np.array([0.0, 0.0, 1.0]), float(np.median(points_m[:, 2]))
    distances = np.abs(sample @ normals.T - np.einsum("ij,ij->i", normals, a))
    counts = np.count_nonzero(distances < _thickness(sample, diameter_m)[:, None], axis=0)
    best = int(np.argmax(counts))
    normal, offset = normals[best], float(normals[best] @ a[best])
    for _ in range(_ROUNDS):
        plane_points = sample[np.abs(sample @ normal - offset) < _thickness(sample, diameter_m)]
        if len(plane_points) < 3:
            break
        mean = plane_points.mean(axis=0)
        normal = np.linalg.eigh((plane_points - mean).T @ (plane_points - mean))[1][:, 0]
        offset = float(normal @ mean)
    return normal, offset


def _components(points_m: FloatArray, mask: BoolArray, link_m: float) -> IntArray:
    """Return the number of the part of each pixel (r c,), the same for linked neighbours; -1 without one."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    rows, columns = mask.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    spacing = _pixel_spacing(points_m)
    limit = np.maximum(link_m, _LINK_SPACINGS * spacing * points_m[..., 2])
    firsts, seconds = [], []
    for first, second in (
        (np.s_[:, :-1], np.s_[:, 1:]),
        (np.s_[:-1], np.s_[1:]),
        (np.s_[:, :-2], np.s_[:, 2:]),
        (np.s_[:-2], np.s_[2:]),
    ):
        with np.errstate(invalid="ignore"):
            distance = np.linalg.norm(points_m[first] - points_m[second], axis=-1)
            is_linked = mask[first] & mask[second] & (distance < limit[first])
        firsts.append(index[first][is_linked])
        seconds.append(index[second][is_linked])
    a, b = np.concatenate(firsts), np.concatenate(seconds)
    graph = coo_matrix((np.ones(len(a), np.int8), (a, b)), shape=(index.size, index.size))
    labels = connected_components(graph, directed=False)[1].astype(np.int64)
    return np.where(mask.ravel(), labels, -1)


def _pixel_spacing(points_m: FloatArray) -> float:
    """Return the distance of neighbouring pixels as a tangent."""
    with np.errstate(invalid="ignore", divide="ignore"):
        tangent = points_m[..., 0] / points_m[..., 2]
        steps = np.abs(np.diff(tangent, axis=1))
    steps = steps[np.isfinite(steps)]
    return float(np.median(steps)) if len(steps) else 0.0
