# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of SHOT: local reference frames and histograms."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import Float32Array, FloatArray, IntArray
from cdff_common.geometry.plane_fits import eigen

AZIMUTHS, ELEVATIONS, SHELLS, COSINES = 8, 2, 2, 11
LENGTH = AZIMUTHS * ELEVATIONS * SHELLS * COSINES
#: Bins of the cosine and one that stays 0, so that each neighbour has two bins.
_ROW = COSINES + 1


def _arctangent() -> tuple[float, ...]:
    """Return the coefficients of t, t^3, ... of ``atan t`` in [0, 1], accurate to 4e-10: 11 terms of its
    Chebyshev series.

    ``atan t = 2 sum (-1)^k q^(2k+1) / (2k+1) T_(2k+1)(t)``, ``q = sqrt 2 - 1`` (Mason, Handscomb 2003, 5.2).
    """
    series = np.zeros(22)
    k = np.arange(11)
    series[1::2] = 2.0 * (-1.0) ** k * (math.sqrt(2.0) - 1.0) ** (2 * k + 1) / (2 * k + 1)
    return tuple(float(c) for c in np.polynomial.chebyshev.cheb2poly(series)[1::2])


_A0, _A1, _A2, _A3, _A4, _A5, _A6, _A7, _A8, _A9, _A10 = _arctangent()


@njit(cache=True, fastmath=True)
def local_frames(
    points: FloatArray, keypoints: FloatArray, start: IntArray, index: IntArray, radius: float
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Return axes x, y, z as rows (k, 3, 3) and ascending variances (k, 3) of ``sum (R - d) (p - q)(p - q)^T
    / sum (R - d)``.

    x and z point to the side with more neighbours; a tie is decided by the sum of the projections, since the
    subset of the paper about the median distance can tie again.
    """
    frames, variance = np.zeros((len(keypoints), 3, 3)), np.zeros((len(keypoints), 3))
    offset = np.empty((3, _largest_count(start)))
    scatter, values, vectors = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    for k in range(len(keypoints)):
        n = start[k + 1] - start[k]
        qx, qy, qz = keypoints[k, 0], keypoints[k, 1], keypoints[k, 2]
        for j in range(n):
            i = index[start[k] + j]
            offset[0, j], offset[1, j], offset[2, j] = points[i, 0] - qx, points[i, 1] - qy, points[i, 2] - qz
        total = xx = xy = xz = yy = yz = zz = sx = sy = sz = 0.0
        for j in range(n):
            x, y, z = offset[0, j], offset[1, j], offset[2, j]
            w = radius - math.sqrt(x * x + y * y + z * z)
            total += w
            xx += w * x * x
            xy += w * x * y
            xz += w * x * z
            yy += w * y * y
            yz += w * y * z
            zz += w * z * z
            sx += x
            sy += y
            sz += z
        if total <= 0.0:
            continue
        scatter[0, 0], scatter[1, 1], scatter[2, 2] = xx / total, yy / total, zz / total
        scatter[1, 0], scatter[2, 0], scatter[2, 1] = xy / total, xz / total, yz / total
        eigen(scatter, values, vectors)
        variance[k] = values
        for row, column in ((0, 2), (2, 0)):
            ax, ay, az = vectors[0, column], vectors[1, column], vectors[2, column]
            majority = 0
            for j in range(n):
                s = offset[0, j] * ax + offset[1, j] * ay + offset[2, j] * az
                majority += (s > 0.0) - (s < 0.0)
            turned = majority < 0 or (majority == 0 and sx * ax + sy * ay + sz * az < 0.0)
            sign = -1.0 if turned else 1.0
            frames[k, row, 0], frames[k, row, 1], frames[k, row, 2] = sign * ax, sign * ay, sign * az
        x, z = frames[k, 0], frames[k, 2]
        frames[k, 1, 0] = z[1] * x[2] - z[2] * x[1]
        frames[k, 1, 1] = z[2] * x[0] - z[0] * x[2]
        frames[k, 1, 2] = z[0] * x[1] - z[1] * x[0]
    return frames, variance


@njit(cache=True, fastmath=True)
def histograms(
    points: FloatArray,
    normals: FloatArray,
    keypoints: FloatArray,
    frames: FloatArray,
    start: IntArray,
    index: IntArray,
    radius: float,
    signed: bool,
) -> Float32Array:  # pragma: no cover - compiled
    """Return one row of 352 per keypoint, unit length; ``frames`` (k, 3, 3) hold the axes x, y, z as rows.

    Order of the bins: azimuth, elevation, shell, cosine (fastest). Each neighbour is distributed over the two
    nearest bins of each dimension with weights ``1 - d``; d is the distance to the bin's centre over the
    distance between centres. Contributions outside the outermost centres of shell and elevation are dropped,
    as the definition has no bin for them.

    Of the two loops the first, over arrays, is vectorised; the second sums with elevations and shells
    adjacent in memory.
    """
    out = np.zeros((len(keypoints), LENGTH), np.float32)
    h = np.zeros(AZIMUTHS * _ROW * 4)
    at = np.empty(
        (6, _largest_count(start))
    )  # positions in bins of azimuth and cosine, weights of elevations and shells
    p = np.empty((6, _largest_count(start)))
    least2 = (1e-12 * radius) ** 2
    for k in range(len(keypoints)):
        n = start[k + 1] - start[k]
        for j in range(n):
            i = index[start[k] + j]
            for c in range(3):
                p[c, j], p[3 + c, j] = points[i, c] - keypoints[k, c], normals[i, c]
        _positions(p, at, n, frames[k], radius, least2, signed)
        h[:] = 0.0
        for j in range(n):
            a, c = int(at[0, j]), int(at[1, j])
            aw, cw = at[0, j] - a, at[1, j] - c
            first, second = (a % AZIMUTHS * _ROW + c) * 4, ((a + 1) % AZIMUTHS * _ROW + c) * 4
            e0, e1, s0, s1 = at[2, j], at[3, j], at[4, j], at[5, j]
            e0s0, e0s1, e1s0, e1s1 = e0 * s0, e0 * s1, e1 * s0, e1 * s1
            for low, w in ((first, 1.0 - aw), (second, aw)):
                v = w * (1.0 - cw)
                h[low] += v * e0s0
                h[low + 1] += v * e0s1
                h[low + 2] += v * e1s0
                h[low + 3] += v * e1s1
                v = w * cw
                h[low + 4] += v * e0s0
                h[low + 5] += v * e0s1
                h[low + 6] += v * e1s0
                h[low + 7] += v * e1s1
        norm = 0.0
        for j in range(len(h)):
            norm += h[j] * h[j]
        if norm <= 0.0:
            continue
        norm = 1.0 / math.sqrt(norm)
        for a in range(AZIMUTHS):
            for es in range(4):
                for c in range(COSINES):
                    out[k, (a * 4 + es) * COSINES + c] = h[(a * _ROW + c) * 4 + es] * norm
    return out


@njit(cache=True, fastmath=True)
def _positions(
    p: FloatArray, at: FloatArray, n: int, axes: FloatArray, radius: float, least2: float, signed: bool
) -> None:  # pragma: no cover - compiled
    """Compute rows of ``at`` from offsets and normals ``p`` (6, n); weights at the keypoint are 0."""
    xx, xy, xz = axes[0, 0], axes[0, 1], axes[0, 2]
    yx, yy, yz = axes[1, 0], axes[1, 1], axes[1, 2]
    zx, zy, zz = axes[2, 0], axes[2, 1], axes[2, 2]
    for j in range(n):
        dx, dy, dz = p[0, j], p[1, j], p[2, j]
        x, y, z = xx * dx + xy * dy + xz * dz, yx * dx + yy * dy + yz * dz, zx * dx + zy * dy + zz * dz
        flat2 = x * x + y * y
        d2 = flat2 + z * z
        cosine = zx * p[3, j] + zy * p[4, j] + zz * p[5, j]
        cosine = cosine if signed else 2.0 * abs(cosine) - 1.0
        cosine = min(max(cosine, -1.0), 1.0)
        turn = angle(y, x) * (0.5 * AZIMUTHS / math.pi) + (0.5 * AZIMUTHS - 0.5)
        turn = turn if turn >= 0.0 else turn + AZIMUTHS
        elevation = angle(z, math.sqrt(flat2)) * (ELEVATIONS / math.pi) + 0.5 * (ELEVATIONS - 1)
        shell = math.sqrt(d2) * (SHELLS / radius) - 0.5
        counts = 1.0 if d2 >= least2 else 0.0
        at[0, j] = turn
        at[1, j] = 0.5 * (1.0 + cosine) * (COSINES - 1)
        at[2, j] = counts * max(1.0 - abs(elevation), 0.0)
        at[3, j] = counts * max(1.0 - abs(elevation - 1.0), 0.0)
        at[4, j] = max(1.0 - abs(shell), 0.0)
        at[5, j] = max(1.0 - abs(shell - 1.0), 0.0)


@njit(cache=True)
def _largest_count(start: IntArray) -> int:  # pragma: no cover - compiled
    """Return the largest number of neighbours."""
    most = 0
    for k in range(len(start) - 1):
        most = max(most, start[k + 1] - start[k])
    return most


@njit(cache=True, inline="always")
def angle(y: float, x: float) -> float:  # pragma: no cover - compiled
    """Return ``atan2(y, x)`` within 1e-9 without branches; 0 where both are 0."""
    ax, ay = abs(x), abs(y)
    t = min(ax, ay) / max(ax, ay, 1e-300)
    u = t * t
    s = _A6 + u * (_A7 + u * (_A8 + u * (_A9 + u * _A10)))
    found = t * (_A0 + u * (_A1 + u * (_A2 + u * (_A3 + u * (_A4 + u * (_A5 + u * s))))))
    found = 0.5 * math.pi - found if ay > ax else found
    found = math.pi - found if x < 0.0 else found
    return -found if y < 0.0 else found
