# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loop over points: linear initial value, refinement, angle, depth and covariance of each point.

Sums are scalars and tuples, which stay in registers; small arrays would be written to memory.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import ByteArray, FloatArray, IntArray

#: A point or gradient: x, y, z.
Three = tuple[float, float, float]
#: A symmetric 3x3 matrix: xx, xy, xz, yy, yz, zz.
Six = tuple[float, float, float, float, float, float]

#: Status of a point.
VALID, FEW_VIEWS, DEGENERATE, BEHIND, SMALL_ANGLE, LARGE_RESIDUAL = 0, 1, 2, 3, 4, 5


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract", "reassoc"})
def _inverse(A: Six) -> tuple[bool, Six]:
    """Return True and the inverse of a symmetric positive definite 3x3 matrix; False if it is singular."""
    a, b, c, d, e, f = A
    x, y, z = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * x + b * y + c * z
    if not (a > 0.0 and d > 0.0 and f > 0.0 and determinant > 1e-13 * a * d * f):
        return False, A
    w = 1.0 / determinant
    return True, (x * w, y * w, z * w, (a * f - c * c) * w, (b * c - a * e) * w, (a * d - b * b) * w)


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract", "reassoc"})
def _times(A: Six, b: Three) -> Three:
    """Return the product of a symmetric matrix and a vector."""
    return (
        A[0] * b[0] + A[1] * b[1] + A[2] * b[2],
        A[1] * b[0] + A[3] * b[1] + A[4] * b[2],
        A[2] * b[0] + A[4] * b[1] + A[5] * b[2],
    )


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract", "reassoc"})
def _linear(
    lo: int, hi: int, cam: IntArray, xy: FloatArray, P: FloatArray, X: Three, by_depth: bool
) -> tuple[bool, Three]:
    """Return True and the least-squares solution of the cross products of observations ``lo`` to ``hi``;
    False if it is not determined. With ``by_depth`` they are divided by the depth of X.
    """
    a00 = a01 = a02 = a11 = a12 = a22 = b0 = b1 = b2 = 0.0
    for k in range(lo, hi):
        p = P[cam[k]]
        w = 1.0
        if by_depth:
            w = p[2, 0] * X[0] + p[2, 1] * X[1] + p[2, 2] * X[2] + p[2, 3]
            w = 1.0 / max(w * w, 1e-18)
        for i in range(2):
            v = xy[k, i]
            r0, r1, r2 = v * p[2, 0] - p[i, 0], v * p[2, 1] - p[i, 1], v * p[2, 2] - p[i, 2]
            q = w * (p[i, 3] - v * p[2, 3])
            a00 += w * r0 * r0
            a01 += w * r0 * r1
            a02 += w * r0 * r2
            a11 += w * r1 * r1
            a12 += w * r1 * r2
            a22 += w * r2 * r2
            b0 += r0 * q
            b1 += r1 * q
            b2 += r2 * q
    determined, inverse = _inverse((a00, a01, a02, a11, a12, a22))
    return determined, _times(inverse, (b0, b1, b2))


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract", "reassoc"})
def _normal_equations(
    lo: int, hi: int, cam: IntArray, xy: FloatArray, P: FloatArray, f: FloatArray, X: Three
) -> tuple[float, float, Six, Three]:
    """Return the sum of squared reprojection errors at X, the smallest depth, normal matrix and gradient."""
    a00 = a01 = a02 = a11 = a12 = a22 = g0 = g1 = g2 = cost = 0.0
    min_depth = np.inf
    for k in range(lo, hi):
        p = P[cam[k]]
        z = p[2, 0] * X[0] + p[2, 1] * X[1] + p[2, 2] * X[2] + p[2, 3]
        min_depth = min(min_depth, z)
        if abs(z) < 1e-12:
            cost = np.inf
            break
        iz = 1.0 / z
        for i in range(2):
            s = f[cam[k], i]
            u = (p[i, 0] * X[0] + p[i, 1] * X[1] + p[i, 2] * X[2] + p[i, 3]) * iz
            r = s * (u - xy[k, i])
            m = s * iz
            j0, j1, j2 = m * (p[i, 0] - u * p[2, 0]), m * (p[i, 1] - u * p[2, 1]), m * (p[i, 2] - u * p[2, 2])
            cost += r * r
            g0 += j0 * r
            g1 += j1 * r
            g2 += j2 * r
            a00 += j0 * j0
            a01 += j0 * j1
            a02 += j0 * j2
            a11 += j1 * j1
            a12 += j1 * j2
            a22 += j2 * j2
    return cost, min_depth, (a00, a01, a02, a11, a12, a22), (g0, g1, g2)


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract", "reassoc"})
def _refine(
    lo: int, hi: int, cam: IntArray, xy: FloatArray, P: FloatArray, f: FloatArray, iterations: int, X: Three
) -> tuple[Three, float, float, Six]:
    """Return point, sum of squares, smallest depth and normal matrix after damped Gauss-Newton steps."""
    cost, depth, A, g = _normal_equations(lo, hi, cam, xy, P, f, X)
    damping = 0.0
    for _ in range(iterations):
        factor = 1.0 + damping
        is_solved, inverse = _inverse((A[0] * factor, A[1], A[2], A[3] * factor, A[4], A[5] * factor))
        if not is_solved:
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e3:
                break
            continue
        step = _times(inverse, g)
        Y = (X[0] - step[0], X[1] - step[1], X[2] - step[2])
        gain = step[0] * g[0] + step[1] * g[1] + step[2] * g[2]
        cost_y, depth_y, A_y, g_y = _normal_equations(lo, hi, cam, xy, P, f, Y)
        if cost_y > cost * (1.0 + 1e-12) + 1e-20 or (depth_y <= 0.0 < depth):
            damping = max(10.0 * damping, 1e-4)
            if damping > 1e6:
                break
            continue
        X, A, g = Y, A_y, g_y
        cost, depth, damping = cost_y, depth_y, damping * 0.1 if damping > 1e-7 else 0.0
        # Convergence is quadratic: the next step is about the square of this one.
        if gain <= 1e-5 * (1.0 + cost):
            break
    return X, cost, depth, A


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract", "reassoc"})
def _angle_cosine(lo: int, hi: int, cam: IntArray, C: FloatArray, X: Three) -> float:
    """Return the smallest cosine between two rays of a point, searched in two passes: the ray at the widest
    angle from the first ray, then the ray at the widest angle from that one.
    """
    row, cosine = lo, 1.0
    for _ in range(2):
        c = C[cam[row]]
        ax, ay, az = c[0] - X[0], c[1] - X[1], c[2] - X[2]
        na = ax * ax + ay * ay + az * az
        farthest_row = row
        for k in range(lo, hi):
            c = C[cam[k]]
            bx, by, bz = c[0] - X[0], c[1] - X[1], c[2] - X[2]
            nb = bx * bx + by * by + bz * bz
            value = (ax * bx + ay * by + az * bz) / np.sqrt(max(na * nb, 1e-300))
            if value < cosine:
                cosine, farthest_row = value, k
        row = farthest_row
    return cosine


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def triangulate(
    start: IntArray,
    cam: IntArray,
    xy: FloatArray,
    P: FloatArray,
    C: FloatArray,
    f: FloatArray,
    iterations: int,
    max_cosine: float,
    max_residual_px: float,
    min_depth: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, ByteArray]:
    """Return points ``(n, 3)``, inverse normal matrices ``(n, 3, 3)``, sums of squared residuals, angles
    (rad) and status of the points.

    ``start (n + 1,)`` is the row of the first observation of each point in ``cam``, the camera, and ``xy``,
    the position on the plane z = 1. ``P (k, 3, 4)`` are T_camera_frame, ``C (k, 3)`` the positions of the
    cameras, ``f (k, 2)`` the focal lengths in pixels.
    """
    n = len(start) - 1
    points, covariances = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    costs, angles, status = np.full(n, np.nan), np.full(n, np.nan), np.zeros(n, np.uint8)
    for i in range(n):
        lo, hi = start[i], start[i + 1]
        if hi - lo < 2:
            status[i] = FEW_VIEWS
            continue
        is_solved, X = _linear(lo, hi, cam, xy, P, (0.0, 0.0, 0.0), False)
        if is_solved:
            is_solved, X = _linear(lo, hi, cam, xy, P, X, True)
        if not is_solved:
            status[i] = DEGENERATE
            continue
        X, cost, depth, A = _refine(lo, hi, cam, xy, P, f, iterations, X)
        points[i, 0], points[i, 1], points[i, 2] = X
        costs[i] = cost
        cosine = _angle_cosine(lo, hi, cam, C, X)
        angles[i] = np.arccos(min(max(cosine, -1.0), 1.0))
        is_solved, S = _inverse(A)
        if not depth > min_depth:
            status[i] = BEHIND
        elif not is_solved:
            status[i] = DEGENERATE
        elif cosine > max_cosine:
            status[i] = SMALL_ANGLE
        elif cost > max_residual_px * max_residual_px * (hi - lo):
            status[i] = LARGE_RESIDUAL
        if status[i] in (VALID, SMALL_ANGLE, LARGE_RESIDUAL):
            c = covariances[i]
            c[0, 0], c[0, 1], c[0, 2], c[1, 1], c[1, 2], c[2, 2] = S
            c[1, 0], c[2, 0], c[2, 1] = S[1], S[2], S[4]
    return points, covariances, costs, angles, status
