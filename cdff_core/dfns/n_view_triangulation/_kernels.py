# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loop over points: linear start, reprojection refinement, angle, depth and covariance of each."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]

#: What became of a point.
FOUND, FEW_VIEWS, DEGENERATE, BEHIND, SMALL_ANGLE, LARGE_RESIDUAL = 0, 1, 2, 3, 4, 5


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract", "reassoc"})
def _inverted(A: Float, out: Float) -> bool:
    """Inverse of a symmetric positive 3x3 matrix; False where it has none."""
    a, b, c, d, e, f = A[0, 0], A[0, 1], A[0, 2], A[1, 1], A[1, 2], A[2, 2]
    x, y, z = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * x + b * y + c * z
    if not (a > 0.0 and d > 0.0 and f > 0.0 and determinant > 1e-13 * a * d * f):
        return False
    w = 1.0 / determinant
    out[0, 0], out[0, 1], out[0, 2] = x * w, y * w, z * w
    out[1, 0], out[1, 1], out[1, 2] = y * w, (a * f - c * c) * w, (b * c - a * e) * w
    out[2, 0], out[2, 1], out[2, 2] = z * w, (b * c - a * e) * w, (a * d - b * b) * w
    return True


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract", "reassoc"})
def _linear(lo: int, hi: int, cam: NDArray[np.int64], xy: Float, P: Float, X: Float, A: Float, inv: Float) -> bool:
    """Least squares on the cross products, weighed by the depths that X has (all alike at first); X is replaced."""
    b0, b1, b2 = 0.0, 0.0, 0.0
    A[:] = 0.0
    weighed = X[3] != 0.0
    for k in range(lo, hi):
        p = P[cam[k]]
        w = 1.0
        if weighed:
            w = p[2, 0] * X[0] + p[2, 1] * X[1] + p[2, 2] * X[2] + p[2, 3]
            w = 1.0 / max(w * w, 1e-18)
        for i in range(2):
            v = xy[k, i]
            r0, r1, r2 = v * p[2, 0] - p[i, 0], v * p[2, 1] - p[i, 1], v * p[2, 2] - p[i, 2]
            q = p[i, 3] - v * p[2, 3]
            A[0, 0] += w * r0 * r0
            A[0, 1] += w * r0 * r1
            A[0, 2] += w * r0 * r2
            A[1, 1] += w * r1 * r1
            A[1, 2] += w * r1 * r2
            A[2, 2] += w * r2 * r2
            b0 += w * r0 * q
            b1 += w * r1 * q
            b2 += w * r2 * q
    if not _inverted(A, inv):
        return False
    X[0] = inv[0, 0] * b0 + inv[0, 1] * b1 + inv[0, 2] * b2
    X[1] = inv[1, 0] * b0 + inv[1, 1] * b1 + inv[1, 2] * b2
    X[2] = inv[2, 0] * b0 + inv[2, 1] * b1 + inv[2, 2] * b2
    X[3] = 1.0
    return True


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract", "reassoc"})
def _normal(
    lo: int, hi: int, cam: NDArray[np.int64], xy: Float, P: Float, f: Float, X: Float, A: Float, g: Float
) -> tuple[float, float]:
    """Normal equations of the reprojection error in pixels at X; its square sum and the least depth."""
    A[:] = 0.0
    g[:] = 0.0
    cost, least = 0.0, np.inf
    for k in range(lo, hi):
        p = P[cam[k]]
        z = p[2, 0] * X[0] + p[2, 1] * X[1] + p[2, 2] * X[2] + p[2, 3]
        least = min(least, z)
        if abs(z) < 1e-12:
            return np.inf, least
        iz = 1.0 / z
        for i in range(2):
            s = f[cam[k], i]
            u = (p[i, 0] * X[0] + p[i, 1] * X[1] + p[i, 2] * X[2] + p[i, 3]) * iz
            r = s * (u - xy[k, i])
            m = s * iz
            j0, j1, j2 = m * (p[i, 0] - u * p[2, 0]), m * (p[i, 1] - u * p[2, 1]), m * (p[i, 2] - u * p[2, 2])
            cost += r * r
            g[0] += j0 * r
            g[1] += j1 * r
            g[2] += j2 * r
            A[0, 0] += j0 * j0
            A[0, 1] += j0 * j1
            A[0, 2] += j0 * j2
            A[1, 1] += j1 * j1
            A[1, 2] += j1 * j2
            A[2, 2] += j2 * j2
    return cost, least


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract", "reassoc"})
def _refined(
    lo: int, hi: int, cam: NDArray[np.int64], xy: Float, P: Float, f: Float, iterations: int, X: Float, Y: Float,
    A: Float, B: Float, inv: Float, g: Float, h: Float,
) -> tuple[float, float]:  # fmt: skip
    """Gauss-Newton, damped when a step does not help; leaves the normal matrix of the last point in A."""
    cost, least = _normal(lo, hi, cam, xy, P, f, X, A, g)
    damping = 0.0
    for _ in range(iterations):
        B[:] = A
        for i in range(3):
            B[i, i] *= 1.0 + damping
        if not _inverted(B, inv):
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e3:
                break
            continue
        gain = 0.0
        for i in range(3):
            step = -(inv[i, 0] * g[0] + inv[i, 1] * g[1] + inv[i, 2] * g[2])
            Y[i] = X[i] + step
            gain -= step * g[i]
        tried, depth = _normal(lo, hi, cam, xy, P, f, Y, B, h)
        if tried > cost * (1.0 + 1e-12) + 1e-20 or (depth <= 0.0 < least):
            damping = max(10.0 * damping, 1e-4)
            if damping > 1e6:
                break
            continue
        X[:3] = Y[:3]
        A[:] = B
        g[:] = h
        cost, least, damping = tried, depth, damping * 0.1 if damping > 1e-7 else 0.0
        if gain <= 1e-5 * (1.0 + cost):  # the next step would be the square of this one
            break
    return cost, least


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract", "reassoc"})
def _angle_cosine(lo: int, hi: int, cam: NDArray[np.int64], C: Float, X: Float) -> float:
    """Least cosine between rays from the point: to the camera farthest round from the first, then from that one."""
    at, cosine = lo, 1.0
    for _ in range(2):
        c = C[cam[at]]
        ax, ay, az = c[0] - X[0], c[1] - X[1], c[2] - X[2]
        na = ax * ax + ay * ay + az * az
        far = at
        for k in range(lo, hi):
            c = C[cam[k]]
            bx, by, bz = c[0] - X[0], c[1] - X[1], c[2] - X[2]
            nb = bx * bx + by * by + bz * bz
            value = (ax * bx + ay * by + az * bz) / np.sqrt(max(na * nb, 1e-300))
            if value < cosine:
                cosine, far = value, k
        at = far
    return cosine


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def triangulated(
    start: NDArray[np.int64], cam: NDArray[np.int64], xy: Float, P: Float, C: Float, f: Float,
    iterations: int, max_cosine: float, max_residual_px: float, min_depth: float,
) -> tuple[Float, Float, Float, Float, NDArray[np.uint8]]:  # fmt: skip
    """Points ``(n, 3)``, inverse normal matrices ``(n, 3, 3)``, square sums, angles (rad) and what became of each.

    ``start (n + 1,)`` says where the views of each point begin in ``cam`` and ``xy``; ``xy`` are on the plane z = 1,
    ``P (k, 3, 4)`` are T_camera_frame, ``C (k, 3)`` the cameras' positions, ``f (k, 2)`` pixels a unit of the plane.
    """
    n = len(start) - 1
    points, covariances = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    costs, angles, status = np.full(n, np.nan), np.full(n, np.nan), np.zeros(n, np.uint8)
    X, Y, A, B, inv, g, h = (
        np.zeros(4), np.zeros(4), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3), np.zeros(3),
    )  # fmt: skip
    for i in range(n):
        lo, hi = start[i], start[i + 1]
        if hi - lo < 2:
            status[i] = FEW_VIEWS
            continue
        X[3] = 0.0
        if not _linear(lo, hi, cam, xy, P, X, A, inv) or not _linear(lo, hi, cam, xy, P, X, A, inv):
            status[i] = DEGENERATE
            continue
        cost, least = _refined(lo, hi, cam, xy, P, f, iterations, X, Y, A, B, inv, g, h)
        points[i] = X[:3]
        costs[i] = cost
        cosine = _angle_cosine(lo, hi, cam, C, X)
        angles[i] = np.arccos(min(max(cosine, -1.0), 1.0))
        if not least > min_depth:
            status[i] = BEHIND
        elif not _inverted(A, inv):
            status[i] = DEGENERATE
        elif cosine > max_cosine:
            status[i] = SMALL_ANGLE
        elif cost > max_residual_px * max_residual_px * (hi - lo):
            status[i] = LARGE_RESIDUAL
        if status[i] in (FOUND, SMALL_ANGLE, LARGE_RESIDUAL):
            covariances[i] = inv
    return points, covariances, costs, angles, status
