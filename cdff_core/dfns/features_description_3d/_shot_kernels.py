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


@njit(cache=True, fastmath={"contract"})
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
    least2 = (1e-12 * radius) ** 2
    for k in range(len(keypoints)):
        h[:] = 0.0
        qx, qy, qz = keypoints[k, 0], keypoints[k, 1], keypoints[k, 2]
        xx, xy, xz = frames[k, 0, 0], frames[k, 0, 1], frames[k, 0, 2]
        yx, yy, yz = frames[k, 1, 0], frames[k, 1, 1], frames[k, 1, 2]
        zx, zy, zz = frames[k, 2, 0], frames[k, 2, 1], frames[k, 2, 2]
        for i in index[start[k] : start[k + 1]]:
            px, py, pz = points[i, 0] - qx, points[i, 1] - qy, points[i, 2] - qz
            d2 = px * px + py * py + pz * pz
            if d2 < least2:
                continue
            x, y, z = xx * px + xy * py + xz * pz, yx * px + yy * py + yz * pz, zx * px + zy * py + zz * pz
            cosine = zx * normals[i, 0] + zy * normals[i, 1] + zz * normals[i, 2]
            if not signed:
                cosine = 2.0 * abs(cosine) - 1.0
            cosine = min(max(cosine, -1.0), 1.0)
            azimuth, latitude = angle(y, x), angle(z, math.sqrt(x * x + y * y))
            c0, c1, u, v = _split(0.5 * (1.0 + cosine) * (COSINES - 1), COSINES)
            e0, e1, ew0, ew1 = _split((latitude / math.pi + 0.5) * ELEVATIONS - 0.5, ELEVATIONS)
            r0, r1, rw0, rw1 = _split(math.sqrt(d2) / radius * SHELLS - 0.5, SHELLS)
            position = (azimuth / (2.0 * math.pi) + 0.5) * AZIMUTHS - 0.5
            first = math.floor(position)
            aw1 = position - first
            a0 = int(first) % AZIMUTHS
            a1 = (a0 + 1) % AZIMUTHS
            for a, aw in ((a0, 1.0 - aw1), (a1, aw1)):
                for e, ew in ((e0, aw * ew0), (e1, aw * ew1)):
                    row = (a * ELEVATIONS + e) * SHELLS
                    at = (row + r0) * COSINES
                    h[at + c0] += ew * rw0 * u
                    h[at + c1] += ew * rw0 * v
                    at = (row + r1) * COSINES
                    h[at + c0] += ew * rw1 * u
                    h[at + c1] += ew * rw1 * v
        norm = 0.0
        for j in range(LENGTH):
            norm += h[j] * h[j]
        if norm > 0.0:
            norm = 1.0 / math.sqrt(norm)
            for j in range(LENGTH):
                out[k, j] = h[j] * norm
    return out


@njit(cache=True, inline="always")
def _split(position: float, count: int) -> tuple[int, int, float, float]:  # pragma: no cover - compiled
    """The two bins about ``position``, whose integers are bin centres, and their weights; 0 for a bin that is not."""
    low = math.floor(position)
    second = position - low
    first = 1.0 - second
    i = int(low)
    j = i + 1
    if i < 0:
        i, first = 0, 0.0
    if j >= count:
        j, second = count - 1, 0.0
    return i, j, first, second


@njit(cache=True, inline="always")
def angle(y: float, x: float) -> float:  # pragma: no cover - compiled
    """``atan2(y, x)`` within 2e-8, at a third of its cost: the arctangent's series after two reductions."""
    ax, ay = abs(x), abs(y)
    most, least = max(ax, ay), min(ax, ay)
    if most == 0.0:
        return 0.0
    t, base = least / most, 0.0
    if t > 0.41421356237309503:  # tan(pi / 8): atan t = pi / 4 + atan((t - 1) / (t + 1))
        t, base = (t - 1.0) / (t + 1.0), 0.25 * math.pi
    u = t * t
    series = 1.0 / 9.0 - u * (1.0 / 11.0 - u * (1.0 / 13.0 - u / 15.0))
    series = 1.0 / 3.0 - u * (1.0 / 5.0 - u * (1.0 / 7.0 - u * series))
    found = base + t * (1.0 - u * series)
    if ay > ax:
        found = 0.5 * math.pi - found
    if x < 0.0:
        found = math.pi - found
    return -found if y < 0.0 else found
