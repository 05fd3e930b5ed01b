# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sampson distances of pairs of points from an epipolar geometry, and their derivatives; compiled.

R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, doi:10.1017/CBO9780511811685, §11.4
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray
from cdff_common.geometry.small_vectors import rotated


def sampson(F: FloatArray, source: FloatArray, sink: FloatArray) -> FloatArray:
    """Return signed Sampson distances ``(n,)``, pixels: first-order distances from the geometry.

    Parameters
    ----------
    F : ndarray, shape (3, 3)
        Fundamental matrix: ``sink' F source = 0``.
    source, sink : ndarray, shape (n, 2)
        Pixels of the first and the second image.
    """
    return _distances(*_contiguous(F, source, sink))


def sampson_derivative(F: FloatArray, source: FloatArray, sink: FloatArray) -> FloatArray:
    """Return the derivative ``(n, 1, 9)`` of the Sampson distances with respect to the row-major entries of
    F.
    """
    return _derivatives(*_contiguous(F, source, sink))


def compile_kernels() -> None:
    """Compile both kernels."""
    F, points = np.eye(3), np.zeros((1, 2))
    sampson(F, points, points)
    sampson_derivative(F, points, points)


def _contiguous(*arrays: FloatArray) -> list[FloatArray]:
    return [np.ascontiguousarray(array, np.float64) for array in arrays]


@njit(cache=True, error_model="numpy")
def _distances(F: FloatArray, source: FloatArray, sink: FloatArray) -> FloatArray:  # pragma: no cover
    """Return the signed Sampson distances (n,) of point pairs (n, 2) to an F matrix, pixels."""
    out = np.empty(len(source))
    for i in range(len(source)):
        x, y, u, v = source[i, 0], source[i, 1], sink[i, 0], sink[i, 1]
        a, b, c = rotated(F, x, y, 1.0)
        d, e, _ = rotated(F.T, u, v, 1.0)
        norm = math.sqrt(a * a + b * b + d * d + e * e)
        out[i] = (u * a + v * b + c) / max(norm, 1e-300)
    return out


@njit(cache=True, error_model="numpy")
def _derivatives(F: FloatArray, source: FloatArray, sink: FloatArray) -> FloatArray:  # pragma: no cover
    """With ``r = y' F x / s``, ``s² = |(F x)_12|² + |(F' y)_12|²``:

    ``dr/dF_jk = (y_j x_k - (r / s) ((F x)_j x_k [j < 2] + y_j (F' y)_k [k < 2])) / s``.
    """
    out = np.empty((len(source), 1, 9))
    for i in range(len(source)):
        x, y, u, v = source[i, 0], source[i, 1], sink[i, 0], sink[i, 1]
        a, b, c = rotated(F, x, y, 1.0)
        d, e, _ = rotated(F.T, u, v, 1.0)
        norm = max(math.sqrt(a * a + b * b + d * d + e * e), 1e-300)
        r = (u * a + v * b + c) / norm / norm
        p, q = (u - r * a) / norm, (v - r * b) / norm
        g, h, w = -r * d / norm, -r * e / norm, 1.0 / norm
        out[i, 0, 0], out[i, 0, 1], out[i, 0, 2] = p * x + u * g, p * y + u * h, p
        out[i, 0, 3], out[i, 0, 4], out[i, 0, 5] = q * x + v * g, q * y + v * h, q
        out[i, 0, 6], out[i, 0, 7], out[i, 0, 8] = w * x + g, w * y + h, w
    return out
