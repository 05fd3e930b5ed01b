# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of SHOT: local reference frames and histograms."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import Float32Array, FloatArray, IntArray
from cdff_common.geometry.plane_fits import eigen

#: Divisions of the sphere around a keypoint, and bins of the cosine between normals.
AZIMUTHS, ELEVATIONS, SHELLS, COSINES = 8, 2, 2, 11
LENGTH = AZIMUTHS * ELEVATIONS * SHELLS * COSINES
#: Bins of the cosine and one that remains 0, so that each value is distributed over two bins.
_ROW = COSINES + 1


def _arctangent_coefficients() -> tuple[float, ...]:
    """Return the coefficients of t, t^3, ... t^21 of a polynomial that equals ``atan t`` in [0, 1] within
    4e-10.

    It is the Chebyshev series of 11 terms, ``atan t = 2 sum (-1)^k q^(2k+1) / (2k+1) T_(2k+1)(t)``, ``q =
    sqrt 2 - 1`` (Mason, Handscomb 2003, 5.2).
    """
    series = np.zeros(22)
    k = np.arange(11)
    series[1::2] = 2.0 * (-1.0) ** k * (math.sqrt(2.0) - 1.0) ** (2 * k + 1) / (2 * k + 1)
    return tuple(float(c) for c in np.polynomial.chebyshev.cheb2poly(series)[1::2])


_A0, _A1, _A2, _A3, _A4, _A5, _A6, _A7, _A8, _A9, _A10 = _arctangent_coefficients()


@njit(cache=True, fastmath=True)
def local_frames(
    points: FloatArray, keypoints: FloatArray, start: IntArray, index: IntArray, radius: float
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Return local frames (k, 3, 3), axes x, y, z as rows, and ascending variances (k, 3) of the keypoints.

    They are the eigenvectors and eigenvalues of the scatter ``sum (R - d) (p - q)(p - q)^T / sum (R - d)`` of
    the neighbours p of keypoint q at distances d within the radius R. x and z point to the side with more
    neighbours. A tie is resolved by the sum of the projections; the paper compares a subset of the
    neighbours, which can tie again.
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
            is_opposite = majority < 0 or (majority == 0 and sx * ax + sy * ay + sz * az < 0.0)
            sign = -1.0 if is_opposite else 1.0
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
    """Return one row of 352 values and unit length per keypoint; ``frames`` (k, 3, 3) hold the axes as rows.

    Order of the bins: azimuth, elevation, shell, cosine (fastest). Each neighbour is distributed over the two
    nearest bins of each dimension with weights ``1 - d``; d is the distance to the centre of the bin in units
    of the distance between centres. Parts beyond the outermost centres of shell and elevation are dropped,
    since the definition has no bin for them.

    The bin positions are computed in a separate loop over arrays, which the compiler vectorises. The
    histogram is summed with elevations and shells adjacent in memory.
    """
    out = np.zeros((len(keypoints), LENGTH), np.float32)
    h = np.zeros(AZIMUTHS * _ROW * 4)
    # Of each neighbour: positions in bins of azimuth and cosine, weights of both elevations and both shells.
    bins = np.empty((6, _largest_count(start)))
    # Offset from the keypoint and normal of each neighbour.
    local = np.empty((6, _largest_count(start)))
    min_distance2 = (1e-12 * radius) ** 2
    for k in range(len(keypoints)):
        n = start[k + 1] - start[k]
        for j in range(n):
            i = index[start[k] + j]
            for c in range(3):
                local[c, j], local[3 + c, j] = points[i, c] - keypoints[k, c], normals[i, c]
        _bin_positions(local, bins, n, frames[k], radius, min_distance2, signed)
        h[:] = 0.0
        for j in range(n):
            a, c = int(bins[0, j]), int(bins[1, j])
            aw, cw = bins[0, j] - a, bins[1, j] - c
            low_azimuth, high_azimuth = (a % AZIMUTHS * _ROW + c) * 4, ((a + 1) % AZIMUTHS * _ROW + c) * 4
            e0, e1, s0, s1 = bins[2, j], bins[3, j], bins[4, j], bins[5, j]
            e0s0, e0s1, e1s0, e1s1 = e0 * s0, e0 * s1, e1 * s0, e1 * s1
            for i0, w in ((low_azimuth, 1.0 - aw), (high_azimuth, aw)):
                v = w * (1.0 - cw)
                h[i0] += v * e0s0
                h[i0 + 1] += v * e0s1
                h[i0 + 2] += v * e1s0
                h[i0 + 3] += v * e1s1
                v = w * cw
                h[i0 + 4] += v * e0s0
                h[i0 + 5] += v * e0s1
                h[i0 + 6] += v * e1s0
                h[i0 + 7] += v * e1s1
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
def _bin_positions(
    local: FloatArray,
    bins: FloatArray,
    n: int,
    axes: FloatArray,
    radius: float,
    min_distance2: float,
    signed: bool,
) -> None:  # pragma: no cover - compiled
    """Write bin positions and weights to ``bins`` (6, n), from offsets and normals ``local`` (6, n).

    The weights of a point closer to the keypoint than ``min_distance2 ** 0.5`` are 0, as it has no direction.
    """
    xx, xy, xz = axes[0, 0], axes[0, 1], axes[0, 2]
    yx, yy, yz = axes[1, 0], axes[1, 1], axes[1, 2]
    zx, zy, zz = axes[2, 0], axes[2, 1], axes[2, 2]
    for j in range(n):
        dx, dy, dz = local[0, j], local[1, j], local[2, j]
        x, y, z = xx * dx + xy * dy + xz * dz, yx * dx + yy * dy + yz * dz, zx * dx + zy * dy + zz * dz
        flat2 = x * x + y * y
        d2 = flat2 + z * z
        cosine = zx * local[3, j] + zy * local[4, j] + zz * local[5, j]
        cosine = cosine if signed else 2.0 * abs(cosine) - 1.0
        cosine = min(max(cosine, -1.0), 1.0)
        azimuth = arctangent(y, x) * (0.5 * AZIMUTHS / math.pi) + (0.5 * AZIMUTHS - 0.5)
        azimuth = azimuth if azimuth >= 0.0 else azimuth + AZIMUTHS
        elevation = arctangent(z, math.sqrt(flat2)) * (ELEVATIONS / math.pi) + 0.5 * (ELEVATIONS - 1)
        shell = math.sqrt(d2) * (SHELLS / radius) - 0.5
        has_direction = 1.0 if d2 >= min_distance2 else 0.0
        bins[0, j] = azimuth
        bins[1, j] = 0.5 * (1.0 + cosine) * (COSINES - 1)
        bins[2, j] = has_direction * max(1.0 - abs(elevation), 0.0)
        bins[3, j] = has_direction * max(1.0 - abs(elevation - 1.0), 0.0)
        bins[4, j] = max(1.0 - abs(shell), 0.0)
        bins[5, j] = max(1.0 - abs(shell - 1.0), 0.0)


@njit(cache=True)
def _largest_count(start: IntArray) -> int:  # pragma: no cover - compiled
    """Return the largest number of neighbours of a keypoint."""
    most = 0
    for k in range(len(start) - 1):
        most = max(most, start[k + 1] - start[k])
    return most


@njit(cache=True, inline="always")
def arctangent(y: float, x: float) -> float:  # pragma: no cover - compiled
    """Return ``atan2(y, x)`` within 1e-9, without branches; 0 if both are 0."""
    ax, ay = abs(x), abs(y)
    t = min(ax, ay) / max(ax, ay, 1e-300)
    u = t * t
    s = _A6 + u * (_A7 + u * (_A8 + u * (_A9 + u * _A10)))
    result = t * (_A0 + u * (_A1 + u * (_A2 + u * (_A3 + u * (_A4 + u * (_A5 + u * s))))))
    result = 0.5 * math.pi - result if ay > ax else result
    result = math.pi - result if x < 0.0 else result
    return -result if y < 0.0 else result
