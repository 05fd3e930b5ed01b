# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops over observations: residuals, normal equations, Schur complement, back substitution.

Arguments of the loops, for m observations ordered by point, n cameras and p points:

- ``cam, pt``: row of the camera and of the point of each observation, ``(m,)``;
- ``pixels``: column, row and right-image column of each observation, ``(m, 3)``; NaN for a single image;
- ``lens``: row of the lens of each camera, ``(n,)``;
- ``R_camera_frame, c``: rotations ``(n, 3, 3)`` and positions of the cameras in the frame ``(n, 3)``;
- ``V, X``: rows of ``BundleLenses.values`` and positions of the points ``(p, 3)``;
- ``start``: first observation of each point, and the total number, ``(p + 1,)``;
- ``columns (n, WIDTH, 2)``, ``count (n,)``: columns of the Jacobian that are adjusted for each camera: its
  first ``count`` entries are pairs of a column of J and its column in H, ascending;
- ``H, g``: normal matrix (lower triangle) and gradient of cameras and lenses;
- ``Hp, gp``: the same of each point, ``(p, 3, 3)`` and ``(p, 3)``;
- ``W``: coupling of the adjusted columns of each observation with its point, ``(m, WIDTH, 3)``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import BoolArray, ByteArray, FloatArray, IntArray
from cdff_common.geometry.small_vectors import cross, rotated

#: Columns of the Jacobian of an observation: six of the pose (x y z rx ry rz in the frame), eight of the lens
#: (f cx cy k1 k2 k3 p1 p2). The order of the lens columns is not that of ``BundleLenses.values``.
POSE, LENS = 6, 8
WIDTH = POSE + LENS
#: Numbers of the robust losses.
NO_LOSS, HUBER, CAUCHY = 0, 1, 2


@njit(cache=True, inline="always", error_model="numpy")
def _project(R_camera_frame: FloatArray, c: FloatArray, v: FloatArray, X: FloatArray) -> tuple[float, ...]:
    """Return depth z, coordinates a, b on the plane z = 1, a^2 + b^2, radial factor, distorted a, b.

    ``R_camera_frame`` and c: rotation (3, 3) and position of the camera; v: row of ``BundleLenses.values``
    (fx fy cx cy k1 k2 p1 p2 k3 baseline); X: the point.
    """
    x, y, z = rotated(R_camera_frame, X[0] - c[0], X[1] - c[1], X[2] - c[2])
    a, b = x / z, y / z
    r2 = a * a + b * b
    s = 1.0 + r2 * (v[4] + r2 * (v[5] + r2 * v[8]))
    u = a * s + 2.0 * v[6] * a * b + v[7] * (r2 + 2.0 * a * a)
    w = b * s + v[6] * (r2 + 2.0 * b * b) + 2.0 * v[7] * a * b
    return z, a, b, r2, s, u, w


@njit(cache=True, inline="always", error_model="numpy")
def _predict_pixels(
    R_camera_frame: FloatArray, c: FloatArray, v: FloatArray, X: FloatArray, out: FloatArray
) -> float:
    """Write column, row and right-image column of the projection of X to ``out``; return its depth."""
    z, _, _, _, _, u, w = _project(R_camera_frame, c, v, X)
    out[0], out[1] = v[0] * u + v[2], v[1] * w + v[3]
    out[2] = out[0] - v[0] * v[9] / z
    return z


@njit(cache=True, inline="always", error_model="numpy")
def _loss(kind: int, scale: float, s: float) -> tuple[float, float]:
    """Return the robust cost rho(s) and its derivative, the weight, for the squared residual s."""
    t = scale * scale
    if kind == HUBER and s > t:
        root = np.sqrt(s)
        return 2.0 * scale * root - t, scale / root
    if kind == CAUCHY:
        return t * np.log1p(s / t), 1.0 / (1.0 + s / t)
    return s, 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def residuals(
    cam: IntArray,
    pt: IntArray,
    pixels: FloatArray,
    lens: IntArray,
    R_camera_frame: FloatArray,
    c: FloatArray,
    V: FloatArray,
    X: FloatArray,
    kind: int,
    scale: float,
) -> tuple[FloatArray, FloatArray, float, float, int]:
    """Return residuals ``(m, 3)``, weights ``(m,)``, robust cost, cost without robust loss, and the number of
    observations of points behind their camera.
    """
    m = len(cam)
    r, weights, out = np.zeros((m, 3)), np.ones(m), np.zeros(3)
    robust, plain, behind = 0.0, 0.0, 0
    for k in range(m):
        z = _predict_pixels(R_camera_frame[cam[k]], c[cam[k]], V[lens[cam[k]]], X[pt[k]], out)
        behind += z <= 0.0
        s = 0.0
        for i in range(3):
            if i < 2 or not np.isnan(pixels[k, 2]):
                r[k, i] = out[i] - pixels[k, i]
                s += r[k, i] * r[k, i]
        rho, weights[k] = _loss(kind, scale, s)
        robust += 0.5 * rho
        plain += 0.5 * s
    return r, weights, robust, plain, behind


@njit(cache=True, inline="always", error_model="numpy")
def _derivatives(
    R_camera_frame: FloatArray,
    c: FloatArray,
    v: FloatArray,
    X: FloatArray,
    stereo: bool,
    J: FloatArray,
    A: FloatArray,
) -> None:
    """Write the derivatives of the prediction with respect to pose and lens to J, and to the point to A
    ``(3, 3)``.

    J has the shape (3, WIDTH); its rows are column, row and right-image column.
    """
    d0, d1, d2 = X[0] - c[0], X[1] - c[1], X[2] - c[2]
    z, a, b, r2, s, u, w = _project(R_camera_frame, c, v, X)
    iz = 1.0 / z
    ds = v[4] + r2 * (2.0 * v[5] + 3.0 * r2 * v[8])  # derivative of s by r2
    # Derivatives of the distorted coordinates u, w with respect to a, b; du/db equals dw/da.
    uu = s + 2.0 * a * a * ds + 2.0 * v[6] * b + 6.0 * v[7] * a
    uw = 2.0 * a * b * ds + 2.0 * v[6] * a + 2.0 * v[7] * b
    ww = s + 2.0 * b * b * ds + 6.0 * v[6] * b + 2.0 * v[7] * a
    for j in range(3):
        da, db = (
            (R_camera_frame[0, j] - a * R_camera_frame[2, j]) * iz,
            (R_camera_frame[1, j] - b * R_camera_frame[2, j]) * iz,
        )
        A[0, j] = v[0] * (uu * da + uw * db)
        A[1, j] = v[1] * (uw * da + ww * db)
        A[2, j] = A[0, j] + v[0] * v[9] * iz * iz * R_camera_frame[2, j]
    ratio = v[1] / v[0]
    J[0, 6], J[1, 6], J[2, 6] = u, w * ratio, u - v[9] * iz
    J[0, 7], J[1, 7], J[2, 7] = 1.0, 0.0, 1.0
    J[0, 8], J[1, 8], J[2, 8] = 0.0, 1.0, 0.0
    J[0, 9], J[1, 9] = v[0] * a * r2, v[1] * b * r2
    J[0, 10], J[1, 10] = J[0, 9] * r2, J[1, 9] * r2
    J[0, 11], J[1, 11] = J[0, 10] * r2, J[1, 10] * r2
    J[0, 12], J[1, 12] = v[0] * 2.0 * a * b, v[1] * (r2 + 2.0 * b * b)
    J[0, 13], J[1, 13] = v[0] * (r2 + 2.0 * a * a), v[1] * 2.0 * a * b
    rows = 3 if stereo else 2
    for i in range(rows):
        if i == 2:
            for j in range(9, WIDTH):
                J[2, j] = J[0, j]
        # A rotation of the camera by phi rotates the point about it by -phi.
        J[i, 0], J[i, 1], J[i, 2] = -A[i, 0], -A[i, 1], -A[i, 2]
        J[i, 3], J[i, 4], J[i, 5] = cross(A[i, 0], A[i, 1], A[i, 2], d0, d1, d2)


@njit(cache=True, nogil=True, error_model="numpy")
def linearise(
    cam: IntArray,
    pt: IntArray,
    pixels: FloatArray,
    lens: IntArray,
    R_camera_frame: FloatArray,
    c: FloatArray,
    V: FloatArray,
    X: FloatArray,
    columns: IntArray,
    count: IntArray,
    r: FloatArray,
    weights: FloatArray,
    point_fixed: ByteArray,
    size: int,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the normal equations H, g, Hp, gp and W for given residuals and weights.

    ``size`` is the number of adjusted columns of cameras and lenses; the entries of fixed points are 0.
    """
    m = len(cam)
    H, g = np.zeros((size, size)), np.zeros(size)
    Hp, gp, W = np.zeros((len(X), 3, 3)), np.zeros((len(X), 3)), np.zeros((m, WIDTH, 3))
    J, A = np.zeros((3, WIDTH)), np.zeros((3, 3))
    for k in range(m):
        i, p = cam[k], pt[k]
        stereo = not np.isnan(pixels[k, 2])
        rows = 3 if stereo else 2
        _derivatives(R_camera_frame[i], c[i], V[lens[i]], X[p], stereo, J, A)
        w = weights[k]
        for row in range(rows):
            e = w * r[k, row]
            for q in range(count[i]):
                jq, hq = J[row, columns[i, q, 0]], columns[i, q, 1]
                g[hq] += jq * e
                wj = w * jq
                for s in range(q + 1):
                    H[hq, columns[i, s, 1]] += wj * J[row, columns[i, s, 0]]
                if not point_fixed[p]:
                    W[k, q, 0] += wj * A[row, 0]
                    W[k, q, 1] += wj * A[row, 1]
                    W[k, q, 2] += wj * A[row, 2]
            if not point_fixed[p]:
                for a in range(3):
                    gp[p, a] += A[row, a] * e
                    for b in range(3):
                        Hp[p, a, b] += w * A[row, a] * A[row, b]
    return H, g, Hp, gp, W


@njit(cache=True, inline="always", error_model="numpy")
def invert_3x3(M: FloatArray, out: FloatArray) -> bool:
    """Write the inverse of a symmetric positive definite matrix to ``out``; return False if singular."""
    a, b, c, d, e, f = M[0, 0], M[0, 1], M[0, 2], M[1, 1], M[1, 2], M[2, 2]
    x, y, z = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * x + b * y + c * z
    out[:] = 0.0
    if not (a > 0.0 and d > 0.0 and f > 0.0 and determinant > 1e-14 * a * d * f):
        return False
    w = 1.0 / determinant
    out[0, 0], out[0, 1], out[0, 2] = x * w, y * w, z * w
    out[1, 0], out[1, 1], out[1, 2] = y * w, (a * f - c * c) * w, (b * c - a * e) * w
    out[2, 0], out[2, 1], out[2, 2] = z * w, (b * c - a * e) * w, (a * d - b * b) * w
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def eliminate_points(
    start: IntArray,
    cam: IntArray,
    columns: IntArray,
    count: IntArray,
    H: FloatArray,
    g: FloatArray,
    Hp: FloatArray,
    gp: FloatArray,
    W: FloatArray,
    damping: float,
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Return the Schur complement S of the points (lower triangle), its right-hand side, the inverses of Hp,
    and which points have a regular block.

    The diagonal of H and Hp is multiplied by ``1 + damping``.
    """
    S, b, inverses = H.copy(), g.copy(), np.zeros_like(Hp)
    is_regular = np.zeros(len(Hp), np.bool_)
    for i in range(len(S)):
        S[i, i] += damping * min(max(S[i, i], 1e-6), 1e32)
    M, Y = np.zeros((3, 3)), np.zeros((WIDTH, 3))
    for p in range(len(Hp)):
        M[:] = Hp[p]
        for i in range(3):
            M[i, i] += damping * min(max(M[i, i], 1e-6), 1e32)
        inv = inverses[p]
        is_regular[p] = invert_3x3(M, inv)
        if not is_regular[p]:
            continue
        for k in range(start[p], start[p + 1]):
            i = cam[k]
            for q in range(count[i]):
                for a in range(3):
                    Y[q, a] = W[k, q, 0] * inv[0, a] + W[k, q, 1] * inv[1, a] + W[k, q, 2] * inv[2, a]
                b[columns[i, q, 1]] -= Y[q, 0] * gp[p, 0] + Y[q, 1] * gp[p, 1] + Y[q, 2] * gp[p, 2]
            for l in range(start[p], k + 1):  # noqa: E741  another observation of the same point
                j = cam[l]
                for q in range(count[i]):
                    hq = columns[i, q, 1]
                    y0, y1, y2 = Y[q, 0], Y[q, 1], Y[q, 2]
                    for s in range(q + 1 if l == k else count[j]):
                        value = y0 * W[l, s, 0] + y1 * W[l, s, 1] + y2 * W[l, s, 2]
                        hs = columns[j, s, 1]
                        if hq > hs:
                            S[hq, hs] -= value
                        elif hq < hs:
                            S[hs, hq] -= value
                        else:
                            S[hq, hq] -= value if l == k else 2.0 * value
    return S, b, inverses, is_regular


@njit(cache=True, nogil=True, error_model="numpy")
def point_steps(
    start: IntArray,
    cam: IntArray,
    columns: IntArray,
    count: IntArray,
    gp: FloatArray,
    W: FloatArray,
    inverses: FloatArray,
    step: FloatArray,
) -> FloatArray:
    """Return the steps ``(p, 3)`` of the points that belong to a step of cameras and lenses."""
    out = np.zeros_like(gp)
    for p in range(len(gp)):
        b0, b1, b2 = -gp[p, 0], -gp[p, 1], -gp[p, 2]
        for k in range(start[p], start[p + 1]):
            i = cam[k]
            for q in range(count[i]):
                d = step[columns[i, q, 1]]
                b0 -= W[k, q, 0] * d
                b1 -= W[k, q, 1] * d
                b2 -= W[k, q, 2] * d
        inv = inverses[p]
        for a in range(3):
            out[p, a] = inv[a, 0] * b0 + inv[a, 1] * b1 + inv[a, 2] * b2
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def point_covariances(
    start: IntArray,
    cam: IntArray,
    columns: IntArray,
    count: IntArray,
    W: FloatArray,
    inverses: FloatArray,
    is_regular: BoolArray,
    C: FloatArray,
) -> FloatArray:
    """Return the covariances ``(p, 3, 3)`` of the points, NaN if undefined.

    C is the covariance of cameras and lenses.
    """
    out = np.full((len(inverses), 3, 3), np.nan)
    Z, M = np.zeros((3, 3)), np.zeros((3, 3))
    for p in range(len(inverses)):
        if not is_regular[p]:
            continue
        Z[:] = 0.0
        for k in range(start[p], start[p + 1]):
            i = cam[k]
            for l in range(start[p], start[p + 1]):  # noqa: E741  another observation of the same point
                j = cam[l]
                for q in range(count[i]):
                    t0, t1, t2 = 0.0, 0.0, 0.0
                    for s in range(count[j]):
                        value = C[columns[i, q, 1], columns[j, s, 1]]
                        t0 += value * W[l, s, 0]
                        t1 += value * W[l, s, 1]
                        t2 += value * W[l, s, 2]
                    for a in range(3):
                        Z[a, 0] += W[k, q, a] * t0
                        Z[a, 1] += W[k, q, a] * t1
                        Z[a, 2] += W[k, q, a] * t2
        inv = inverses[p]
        for a in range(3):
            for b in range(3):
                M[a, b] = inv[a, 0] * Z[0, b] + inv[a, 1] * Z[1, b] + inv[a, 2] * Z[2, b]
        for a in range(3):
            for b in range(3):
                out[p, a, b] = inv[a, b] + M[a, 0] * inv[0, b] + M[a, 1] * inv[1, b] + M[a, 2] * inv[2, b]
    return out
