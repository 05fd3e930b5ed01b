# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of SHOT: scatter and signs of the local reference frame, and the histogram."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int = NDArray[np.int64]

AZIMUTHS, ELEVATIONS, SHELLS, COSINES = 8, 2, 2, 11
LENGTH = AZIMUTHS * ELEVATIONS * SHELLS * COSINES


@njit(cache=True)
def scatters(points: Float, keypoints: Float, start: Int, index: Int, radius: float) -> Float:  # pragma: no cover
    """Weighted scatter about each keypoint, (k, 3, 3): ``sum (R - d) (p - q)(p - q)^T / sum (R - d)``."""
    out = np.zeros((len(keypoints), 3, 3))
    for k in range(len(keypoints)):
        total = 0.0
        xx = xy = xz = yy = yz = zz = 0.0
        for i in index[start[k] : start[k + 1]]:
            x, y, z = points[i, 0] - keypoints[k, 0], points[i, 1] - keypoints[k, 1], points[i, 2] - keypoints[k, 2]
            w = radius - math.sqrt(x * x + y * y + z * z)
            total += w
            xx += w * x * x
            xy += w * x * y
            xz += w * x * z
            yy += w * y * y
            yz += w * y * z
            zz += w * z * z
        if total > 0.0:
            m = out[k]
            m[0, 0], m[1, 1], m[2, 2] = xx / total, yy / total, zz / total
            m[0, 1] = m[1, 0] = xy / total
            m[0, 2] = m[2, 0] = xz / total
            m[1, 2] = m[2, 1] = yz / total
    return out


@njit(cache=True)
def turn_to_majority(axis: Float, points: Float, keypoints: Float, start: Int, index: Int) -> None:  # pragma: no cover
    """Negate each ``axis`` (k, 3) that has more neighbours behind it than before it.

    On a tie the sum of the projections decides: the paper's subset about the median distance can tie again.
    """
    for k in range(len(keypoints)):
        before, behind, total = 0, 0, 0.0
        for i in index[start[k] : start[k + 1]]:
            s = 0.0
            for c in range(3):
                s += (points[i, c] - keypoints[k, c]) * axis[k, c]
            total += s
            if s > 0.0:
                before += 1
            elif s < 0.0:
                behind += 1
        if behind > before or (behind == before and total < 0.0):
            for c in range(3):
                axis[k, c] = -axis[k, c]


@njit(cache=True)
def histograms(
    points: Float, normals: Float, keypoints: Float, frames: Float, start: Int, index: Int, radius: float, signed: bool
) -> Float32:  # pragma: no cover - compiled
    """One row of 352 per keypoint, unit length; ``frames`` (k, 3, 3) hold the axes x, y, z as rows.

    Order of the bins: azimuth, elevation, shell, cosine (fastest). Each neighbour is spread over the two nearest bins
    of each dimension with weights ``1 - d``; d is the distance to the bin's centre over the distance between centres.
    What falls outside the outermost centres of shell and elevation is lost, as the definition has no bin for it.
    """
    out = np.zeros((len(keypoints), LENGTH), np.float32)
    h = np.zeros(LENGTH)
    a_bin, e_bin = np.zeros(2, np.int64), np.zeros(2, np.int64)
    r_bin, c_bin = np.zeros(2, np.int64), np.zeros(2, np.int64)
    a_w, e_w, r_w, c_w = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    for k in range(len(keypoints)):
        h[:] = 0.0
        for i in index[start[k] : start[k + 1]]:
            px, py, pz = points[i, 0] - keypoints[k, 0], points[i, 1] - keypoints[k, 1], points[i, 2] - keypoints[k, 2]
            distance = math.sqrt(px * px + py * py + pz * pz)
            if distance < 1e-12 * radius:
                continue
            f = frames[k]
            x = f[0, 0] * px + f[0, 1] * py + f[0, 2] * pz
            y = f[1, 0] * px + f[1, 1] * py + f[1, 2] * pz
            z = f[2, 0] * px + f[2, 1] * py + f[2, 2] * pz
            cosine = f[2, 0] * normals[i, 0] + f[2, 1] * normals[i, 1] + f[2, 2] * normals[i, 2]
            if not signed:
                cosine = 2.0 * abs(cosine) - 1.0
            cosine = min(max(cosine, -1.0), 1.0)
            _split(0.5 * (1.0 + cosine) * (COSINES - 1), COSINES, False, c_bin, c_w)
            _split((math.atan2(y, x) / (2.0 * math.pi) + 0.5) * AZIMUTHS - 0.5, AZIMUTHS, True, a_bin, a_w)
            latitude = math.asin(min(max(z / distance, -1.0), 1.0))
            _split((latitude / math.pi + 0.5) * ELEVATIONS - 0.5, ELEVATIONS, False, e_bin, e_w)
            _split(distance / radius * SHELLS - 0.5, SHELLS, False, r_bin, r_w)
            for a in range(2):
                for e in range(2):
                    for r in range(2):
                        w = a_w[a] * e_w[e] * r_w[r]
                        if w > 0.0:
                            volume = ((a_bin[a] * ELEVATIONS + e_bin[e]) * SHELLS + r_bin[r]) * COSINES
                            h[volume + c_bin[0]] += w * c_w[0]
                            h[volume + c_bin[1]] += w * c_w[1]
        norm = 0.0
        for j in range(LENGTH):
            norm += h[j] * h[j]
        if norm > 0.0:
            norm = 1.0 / math.sqrt(norm)
            for j in range(LENGTH):
                out[k, j] = h[j] * norm
    return out


@njit(cache=True, inline="always")
def _split(position: float, count: int, wraps: bool, bins: Int, weight: Float) -> None:  # pragma: no cover - compiled
    """The two bins about ``position``, whose integers are bin centres, and their weights; 0 for a bin that is not."""
    low = math.floor(position)
    fraction = position - low
    first = int(low)
    second = first + 1
    weight[0], weight[1] = 1.0 - fraction, fraction
    if wraps:
        bins[0], bins[1] = first % count, second % count
        return
    if first < 0:
        first, weight[0] = 0, 0.0
    if second >= count:
        second, weight[1] = count - 1, 0.0
    bins[0], bins[1] = first, second
