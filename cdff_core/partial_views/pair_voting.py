# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose hypotheses from pairs of oriented points.

Drost, Ulrich, Navab, Ilic (2010), doi:10.1109/CVPR.2010.5540108. The feature of two points with normals is
their distance and three angles. The pairs of the model are sorted by quantised feature. Each reference point
of the scene forms pairs with its neighbours; each pair votes for a model point and a rotation about the
normal, which determine a pose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry.small_vectors import cross

ANGLES = 15  # bins of each angle of a feature, over 180 degrees
ROTATIONS = 36  # bins of the rotation about the normal


@dataclass(frozen=True, slots=True, eq=False)
class PairTable:
    """Point pairs of a model, sorted by feature.

    Attributes
    ----------
    points_m, normals : ndarray, shape (n, 3)
        Points of the model, metres, and unit normals.
    step_m, diameter_m : float
        Width of the bins of the distance, and diameter of the model, metres.
    start : ndarray of int, shape (features + 1,)
        Pairs of feature k are the rows ``start[k]`` to ``start[k + 1]``.
    first : ndarray of int, shape (pairs,)
        First point of each pair.
    rotation : ndarray, shape (pairs,)
        Angle of the second point about the normal of the first, radians.
    """

    points_m: FloatArray
    normals: FloatArray
    step_m: float
    diameter_m: float
    start: IntArray
    first: IntArray
    rotation: FloatArray


def pair_table(points_m: FloatArray, normals: FloatArray, step_m: float) -> PairTable:
    """Return the table of all ordered pairs of points ``(n, 3)``; distances have bins of ``step_m``."""
    offset = points_m - points_m.mean(axis=0)
    diameter_m = 2.0 * float(np.sqrt(np.max(np.sum(offset**2, axis=1))))
    bins = int(diameter_m / step_m) + 1
    key, first, rotation = _model_pairs(points_m, normals, step_m, bins)
    order = np.argsort(key, kind="stable")
    start = np.searchsorted(key[order], np.arange(bins * ANGLES**3 + 1))
    return PairTable(points_m, normals, step_m, diameter_m, start, first[order], rotation[order])


def vote(
    table: PairTable,
    points_m: FloatArray,
    normals: FloatArray,
    references: IntArray,
    start: IntArray,
    index: IntArray,
    peaks: int,
) -> FloatArray:
    """Return the ``peaks`` poses with the most votes for each reference point.

    Parameters
    ----------
    table : PairTable
    points_m, normals : FloatArray, shape (n, 3)
        Points of the scene, metres, and unit normals.
    references : IntArray, shape (r,)
        Rows of the reference points.
    start, index : IntArray, shapes (r + 1,) and (m,)
        The neighbours of reference i are the points ``index[start[i]:start[i + 1]]``.
    peaks : int
        Number of poses for each reference point.

    Returns
    -------
    FloatArray, shape (r * peaks, 4, 4)
        ``T_scene_model``, metres.
    """
    bins = int(table.diameter_m / table.step_m) + 1
    return _vote(
        table.points_m,
        table.normals,
        table.step_m,
        bins,
        table.start,
        table.first,
        table.rotation,
        points_m,
        normals,
        references,
        start,
        index,
        peaks,
    )


@njit(cache=True, inline="always")
def _angle_bin(cosine: float) -> int:  # pragma: no cover - compiled
    return min(int(math.acos(min(max(cosine, -1.0), 1.0)) * (ANGLES / math.pi)), ANGLES - 1)


@njit(cache=True)
def _aligning_rotation(n: FloatArray) -> FloatArray:  # pragma: no cover - compiled
    """Return the rotation (3, 3) that maps the unit vector n to x."""
    R = np.empty((3, 3))
    R[0] = n
    if abs(n[0]) < 0.7:
        x, y, z = 0.0, n[2], -n[1]
    else:
        x, y, z = -n[2], 0.0, n[0]
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    R[1, 0], R[1, 1], R[1, 2] = x, y, z
    R[2, 0], R[2, 1], R[2, 2] = cross(n[0], n[1], n[2], x, y, z)
    return R


@njit(cache=True)
def _pair(
    p: FloatArray,
    n: FloatArray,
    R_aligned_point: FloatArray,
    q: FloatArray,
    m: FloatArray,
    step: float,
    bins: int,
) -> tuple[int, float]:  # pragma: no cover - compiled
    """Return the feature of a pair, -1 if it is not in the table, and the angle of the second point."""
    x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    d = math.sqrt(x * x + y * y + z * z)
    k = int(d / step)
    if d < step or k >= bins:
        return -1, 0.0
    a = _angle_bin((x * n[0] + y * n[1] + z * n[2]) / d)
    b = _angle_bin((x * m[0] + y * m[1] + z * m[2]) / d)
    c = _angle_bin(n[0] * m[0] + n[1] * m[1] + n[2] * m[2])
    v = R_aligned_point[1, 0] * x + R_aligned_point[1, 1] * y + R_aligned_point[1, 2] * z
    w = R_aligned_point[2, 0] * x + R_aligned_point[2, 1] * y + R_aligned_point[2, 2] * z
    return ((k * ANGLES + a) * ANGLES + b) * ANGLES + c, math.atan2(w, v)


@njit(cache=True)
def _model_pairs(
    points: FloatArray, normals: FloatArray, step: float, bins: int
) -> tuple[IntArray, IntArray, FloatArray]:  # pragma: no cover - compiled
    """Return feature key, first point and rotation of all pairs of model points."""
    n = len(points)
    key, first, rotation = np.empty(n * n, np.int64), np.empty(n * n, np.int64), np.empty(n * n)
    count = 0
    for i in range(n):
        R_aligned_point = _aligning_rotation(normals[i])
        for j in range(n):
            if i == j:
                continue
            k, angle = _pair(points[i], normals[i], R_aligned_point, points[j], normals[j], step, bins)
            if k >= 0:
                key[count], first[count], rotation[count] = k, i, angle
                count += 1
    return key[:count], first[:count], rotation[:count]


@njit(cache=True)
def _vote(
    model: FloatArray,
    model_normals: FloatArray,
    step: float,
    bins: int,
    table_start: IntArray,
    first: IntArray,
    rotation: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    references: IntArray,
    start: IntArray,
    index: IntArray,
    peaks: int,
) -> FloatArray:  # pragma: no cover - compiled
    """Return the poses (r * peaks, 4, 4) with most votes for each reference point of the scan."""
    n = len(model)
    votes = np.empty((n, ROTATIONS), np.float32)
    smooth = np.empty((n, ROTATIONS), np.float32)
    poses = np.zeros((len(references) * peaks, 4, 4))
    for r in range(len(references)):
        i = references[r]
        votes[:] = 0.0
        R_aligned_scan = _aligning_rotation(normals[i])
        for j in index[start[r] : start[r + 1]]:
            if j == i:
                continue
            k, angle = _pair(points[i], normals[i], R_aligned_scan, points[j], normals[j], step, bins)
            if k < 0:
                continue
            low, high = table_start[k], table_start[k + 1]
            # A feature with more pairs than model points does not discriminate between them.
            if high == low or high - low > n:
                continue
            w = 1.0 / math.sqrt(high - low)
            for row in range(low, high):
                rotation_bins = (angle - rotation[row]) * (ROTATIONS / (2.0 * math.pi))
                b = int(rotation_bins + 2.0 * ROTATIONS + 0.5) % ROTATIONS
                votes[first[row], b] += w
        for m in range(n):
            for b in range(ROTATIONS):
                smooth[m, b] = votes[m, b] + 0.5 * votes[m, (b + 1) % ROTATIONS] + 0.5 * votes[m, b - 1]
        for peak in range(peaks):
            highest_bin = int(np.argmax(smooth))
            m, b = highest_bin // ROTATIONS, highest_bin % ROTATIONS
            row = r * peaks + peak
            angle = b * 2.0 * math.pi / ROTATIONS
            # Rotation of the pose: R_aligned_scan^T Rx(angle) R_aligned_model
            R_aligned_model = _aligning_rotation(model_normals[m])
            c, s = math.cos(angle), math.sin(angle)
            R_rotated_model = np.empty((3, 3))
            for col in range(3):
                R_rotated_model[0, col] = R_aligned_model[0, col]
                R_rotated_model[1, col] = c * R_aligned_model[1, col] - s * R_aligned_model[2, col]
                R_rotated_model[2, col] = s * R_aligned_model[1, col] + c * R_aligned_model[2, col]
            for x in range(3):
                for y in range(3):
                    poses[row, x, y] = (
                        R_aligned_scan[0, x] * R_rotated_model[0, y]
                        + R_aligned_scan[1, x] * R_rotated_model[1, y]
                        + R_aligned_scan[2, x] * R_rotated_model[2, y]
                    )
            for x in range(3):
                poses[row, x, 3] = points[i, x] - (
                    poses[row, x, 0] * model[m, 0]
                    + poses[row, x, 1] * model[m, 1]
                    + poses[row, x, 2] * model[m, 2]
                )
            poses[row, 3, 3] = 1.0
            for other in range(-2, 3):
                smooth[m, (b + other) % ROTATIONS] = 0.0
    return poses
