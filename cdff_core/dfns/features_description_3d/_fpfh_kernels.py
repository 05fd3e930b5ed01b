# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of FPFH: simplified point feature histograms (SPFH) and their weighted sums."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry.small_vectors import cross

#: Bins of each of the three angles.
BINS = 11


@njit(cache=True)
def simplified_histograms(
    points: FloatArray, normals: FloatArray, rows: IntArray, start: IntArray, index: IntArray
) -> FloatArray:  # pragma: no cover
    """Return the SPFH (k, 33) of the points ``rows``: histograms of three angles to their neighbours.

    The neighbours of point ``rows[k]`` are ``index[start[k]:start[k + 1]]``. Each histogram of 11 bins sums
    up to 100.
    """
    out = np.zeros((len(rows), 3 * BINS))
    for k in range(len(rows)):
        p = rows[k]
        pair_count = 0
        for q in index[start[k] : start[k + 1]]:
            dx, dy, dz = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1], points[q, 2] - points[p, 2]
            d = math.sqrt(dx * dx + dy * dy + dz * dz)
            if q == p or d == 0.0:
                continue
            origin, other = p, q
            dx, dy, dz = dx / d, dy / d, dz / d
            cos_p = dx * normals[p, 0] + dy * normals[p, 1] + dz * normals[p, 2]
            cos_q = dx * normals[q, 0] + dy * normals[q, 1] + dz * normals[q, 2]
            # The origin of the pair is the point whose normal is closer to the line between both.
            if abs(cos_q) > abs(cos_p):
                origin, other = q, p
                dx, dy, dz = -dx, -dy, -dz
                phi = -cos_q
            else:
                phi = cos_p
            ux, uy, uz = normals[origin, 0], normals[origin, 1], normals[origin, 2]
            vx, vy, vz = cross(dx, dy, dz, ux, uy, uz)
            length = math.sqrt(vx * vx + vy * vy + vz * vz)
            if length < 1e-12:
                continue
            vx, vy, vz = vx / length, vy / length, vz / length
            wx, wy, wz = cross(ux, uy, uz, vx, vy, vz)
            nx, ny, nz = normals[other, 0], normals[other, 1], normals[other, 2]
            alpha = vx * nx + vy * ny + vz * nz
            theta = math.atan2(wx * nx + wy * ny + wz * nz, ux * nx + uy * ny + uz * nz)
            out[k, _bin((theta + math.pi) / (2.0 * math.pi))] += 1.0
            out[k, BINS + _bin(0.5 * (alpha + 1.0))] += 1.0
            out[k, 2 * BINS + _bin(0.5 * (phi + 1.0))] += 1.0
            pair_count += 1
        if pair_count > 0:
            out[k] *= 100.0 / pair_count
    return out


@njit(cache=True, inline="always")
def _bin(fraction: float) -> int:  # pragma: no cover - compiled
    """Return the bin of a value in [0, 1]."""
    return min(max(int(fraction * BINS), 0), BINS - 1)


@njit(cache=True)
def weighted_histograms(
    points: FloatArray,
    keypoints: FloatArray,
    spfh: FloatArray,
    spfh_row: IntArray,
    start: IntArray,
    index: IntArray,
) -> FloatArray:  # pragma: no cover - compiled
    """Return sums (k, 33) of the neighbours' SPFH, weighted by their inverse squared distance.

    ``spfh_row`` holds the row in ``spfh`` of each point. The histogram of each angle is scaled to a sum of
    100.
    """
    out = np.zeros((len(keypoints), 3 * BINS))
    for k in range(len(keypoints)):
        for q in index[start[k] : start[k + 1]]:
            d2 = 0.0
            for c in range(3):
                d2 += (points[q, c] - keypoints[k, c]) ** 2
            if d2 > 0.0:
                out[k] += spfh[spfh_row[q]] / d2
        for angle in range(3):
            histogram = out[k, angle * BINS : (angle + 1) * BINS]
            total = histogram.sum()
            if total > 0.0:
                histogram *= 100.0 / total
    return out
