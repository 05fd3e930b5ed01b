# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of FPFH: simplified histograms of points, and their weighted sums."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray, IntArray

BINS = 11


@njit(cache=True)
def simplified(
    points: FloatArray, normals: FloatArray, which: IntArray, start: IntArray, index: IntArray
) -> FloatArray:  # pragma: no cover
    """Return histograms (k, 33) of the angles between points of ``which`` and neighbours; sum 100 each."""
    out = np.zeros((len(which), 3 * BINS))
    for k in range(len(which)):
        p = which[k]
        count = 0
        for q in index[start[k] : start[k + 1]]:
            dx, dy, dz = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1], points[q, 2] - points[p, 2]
            d = math.sqrt(dx * dx + dy * dy + dz * dz)
            if q == p or d == 0.0:
                continue
            s, t = p, q
            dx, dy, dz = dx / d, dy / d, dz / d
            cos_p = dx * normals[p, 0] + dy * normals[p, 1] + dz * normals[p, 2]
            cos_q = dx * normals[q, 0] + dy * normals[q, 1] + dz * normals[q, 2]
            # The origin is the point whose normal is closer to the line between the two.
            if abs(cos_q) > abs(cos_p):
                s, t = q, p
                dx, dy, dz = -dx, -dy, -dz
                phi = -cos_q
            else:
                phi = cos_p
            ux, uy, uz = normals[s, 0], normals[s, 1], normals[s, 2]
            vx, vy, vz = dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux
            length = math.sqrt(vx * vx + vy * vy + vz * vz)
            if length < 1e-12:
                continue
            vx, vy, vz = vx / length, vy / length, vz / length
            wx, wy, wz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            nx, ny, nz = normals[t, 0], normals[t, 1], normals[t, 2]
            alpha = vx * nx + vy * ny + vz * nz
            theta = math.atan2(wx * nx + wy * ny + wz * nz, ux * nx + uy * ny + uz * nz)
            out[k, _bin((theta + math.pi) / (2.0 * math.pi))] += 1.0
            out[k, BINS + _bin(0.5 * (alpha + 1.0))] += 1.0
            out[k, 2 * BINS + _bin(0.5 * (phi + 1.0))] += 1.0
            count += 1
        if count > 0:
            out[k] *= 100.0 / count
    return out


@njit(cache=True, inline="always")
def _bin(share: float) -> int:  # pragma: no cover - compiled
    return min(max(int(share * BINS), 0), BINS - 1)


@njit(cache=True)
def weighted(
    points: FloatArray,
    keypoints: FloatArray,
    spfh: FloatArray,
    row: IntArray,
    start: IntArray,
    index: IntArray,
) -> FloatArray:  # pragma: no cover - compiled
    """Return sums of neighbours' histograms by inverse squared distance, each third scaled to 100."""
    out = np.zeros((len(keypoints), 3 * BINS))
    for k in range(len(keypoints)):
        for q in index[start[k] : start[k + 1]]:
            d2 = 0.0
            for c in range(3):
                d2 += (points[q, c] - keypoints[k, c]) ** 2
            if d2 > 0.0:
                out[k] += spfh[row[q]] / d2
        for third in range(3):
            part = out[k, third * BINS : (third + 1) * BINS]
            total = part.sum()
            if total > 0.0:
                part *= 100.0 / total
    return out
