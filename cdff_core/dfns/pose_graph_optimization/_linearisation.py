# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops over the edges of a pose graph: errors, Jacobians and normal equations.

``X_a`` is the pose ``T_frame_a`` of vertex a, and Z the measured ``T_a_b`` of an edge, or the ``T_frame_a``
of a prior. The equations are those of ``cdff_common.geometry.se3``, numbered as in Sola et al. (2018),
arXiv:1812.01537.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.geometry.small_vectors import cross

#: Angle below which functions of the angle are computed by their series, radians.
_SMALL = 1e-2
_AXES = (0, 1, 2)


@njit(cache=True)
def squared_errors(
    poses: FloatArray,
    a: IntArray,
    b: IntArray,
    measured: FloatArray,
    information: FloatArray,
    rows: tuple[int, ...],
) -> FloatArray:  # pragma: no cover - compiled
    """Return ``e' information e`` ``(m,)`` with the rows of ``e = Log(Z^-1 X_a^-1 X_b)`` of each edge; of a
    prior (a equals b) ``Log(Z^-1 X_a)``.
    """
    out = np.zeros(len(a))
    between, E, e = np.empty((3, 4)), np.empty((3, 4)), np.empty(6)
    for k in range(len(a)):
        _edge_error(poses, a[k], b[k], measured[k], between, E, e)
        for i in range(len(rows)):
            for j in range(len(rows)):
                out[k] += e[rows[i]] * information[k, i, j] * e[rows[j]]
    return out


@njit(cache=True)
def accumulate(
    poses: FloatArray,
    a: IntArray,
    b: IntArray,
    measured: FloatArray,
    information: FloatArray,
    weights: FloatArray,
    rows: tuple[int, ...],
    position: IntArray,
    slot: IntArray,
    is_a_later: BoolArray,
    diagonal: FloatArray,
    lower: FloatArray,
    gradient: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Add Hessian and gradient of ``0.5 sum weight e' information e`` for steps ``X Exp(x)``.

    Parameters
    ----------
    rows : tuple of d int
        Unknowns of a pose. A tuple has a length known to the compiler, which unrolls the loops over it.
    position : ndarray of int64, shape (n,)
        Position of each pose in the order of elimination, -1 for a fixed pose.
    slot, is_a_later : ndarray, shape (m,)
        Block of each edge between free poses, and whether its row is vertex a.
    diagonal, lower, gradient : ndarray, shapes (f, d, d), (s, d, d) and (f, d)
        Sums in the order of elimination.
    """
    d = len(rows)
    between, E, e = np.empty((3, 4)), np.empty((3, 4)), np.empty(6)
    products, full, J, A = np.zeros((11, 3, 3)), np.zeros((6, 6)), np.empty((d, d)), np.zeros((d, d))
    WJ, M, N, h, part = np.empty((d, d)), np.empty((d, d)), np.empty((d, d)), np.empty(d), np.empty(d)
    for k in range(len(a)):
        _edge_error(poses, a[k], b[k], measured[k], between, E, e)
        _inverse_right_jacobian(e, full, products)
        _select(full, rows, J)
        for i in range(d):
            part[i] = 0.0
            for j in range(d):
                part[i] += weights[k] * information[k, i, j] * e[rows[j]]
        _multiply(information[k], J, weights[k], WJ, rows)
        _multiply_transposed(J, WJ, M, rows)
        for i in range(d):
            h[i] = 0.0
            for j in range(d):
                h[i] += J[j, i] * part[j]
        q = position[b[k]]
        if q >= 0:
            _add(M, 1.0, diagonal[q], rows)
            for i in range(d):
                gradient[q, i] += h[i]
        p = position[a[k]]
        if p < 0 or a[k] == b[k]:
            continue
        # A step x_a of pose a changes the error as the step -Ad(X_b^-1 X_a) x_a of pose b.
        _adjoint_of_inverse(between, full)
        _select(full, rows, A)
        _multiply(M, A, 1.0, N, rows)
        _multiply_transposed(A, N, WJ, rows)
        _add(WJ, 1.0, diagonal[p], rows)
        for i in range(d):
            for j in range(d):
                gradient[p, i] -= A[j, i] * h[j]
        if q >= 0:
            _add(N.T if is_a_later[k] else N, -1.0, lower[slot[k]], rows)


@njit(cache=True)
def _edge_error(
    poses: FloatArray, a: int, b: int, Z: FloatArray, between: FloatArray, E: FloatArray, e: FloatArray
) -> None:  # pragma: no cover - compiled
    """Write ``X_a^-1 X_b`` (of a prior ``X_a``), ``E = Z^-1 X_a^-1 X_b`` and its logarithm."""
    if a == b:
        between[:] = poses[a, :3]
    else:
        _relative(poses[a], poses[b], between)
    _relative(Z, between, E)
    _logarithm(E, e)


@njit(cache=True)
def _relative(A: FloatArray, B: FloatArray, out: FloatArray) -> None:  # pragma: no cover - compiled
    """Write the upper three rows of ``A^-1 B``."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[0, i] * B[0, j] + A[1, i] * B[1, j] + A[2, i] * B[2, j]
        out[i, 3] = (
            A[0, i] * (B[0, 3] - A[0, 3]) + A[1, i] * (B[1, 3] - A[1, 3]) + A[2, i] * (B[2, 3] - A[2, 3])
        )


@njit(cache=True)
def _logarithm(E: FloatArray, e: FloatArray) -> None:  # pragma: no cover - compiled
    """Write the twist ``[rho phi]`` of a transform (eq. 133, 146, 173)."""
    trace = E[0, 0] + E[1, 1] + E[2, 2]
    # 4 q q^T: its row with the largest diagonal element is the most accurate multiple of the quaternion.
    largest, value = 3, trace
    for i in range(3):
        if E[i, i] > value:
            largest, value = i, E[i, i]
    i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
    if largest == 3:
        e[3], e[4], e[5], w = E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1], 1.0 + trace
    else:
        e[3 + i], e[3 + j], e[3 + k] = 1.0 + 2.0 * E[i, i] - trace, E[i, j] + E[j, i], E[i, k] + E[k, i]
        w = E[k, j] - E[j, k]
    sine = math.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5])
    angle = 2.0 * math.atan2(sine, abs(w))
    scale = angle / sine if sine > 1e-300 else 0.0
    scale = -scale if w < 0.0 else scale
    x, y, z = scale * e[3], scale * e[4], scale * e[5]
    c = _quadratic_coefficient(angle)
    tx, ty, tz = E[0, 3], E[1, 3], E[2, 3]
    # J_l(phi)^-1 t = t - phi x t / 2 + c phi x (phi x t)
    ux, uy, uz = cross(x, y, z, tx, ty, tz)
    vx, vy, vz = cross(x, y, z, ux, uy, uz)
    e[0], e[1], e[2] = tx - 0.5 * ux + c * vx, ty - 0.5 * uy + c * vy, tz - 0.5 * uz + c * vz
    e[3], e[4], e[5] = x, y, z


@njit(cache=True)
def _quadratic_coefficient(angle: float) -> float:  # pragma: no cover - compiled
    """Return the coefficient of ``[phi]x^2`` in ``J_l(phi)^-1``: ``(1 - t/2 cot(t/2)) / t^2``."""
    if angle < _SMALL:
        return 1.0 / 12.0 + angle * angle / 720.0
    return (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / (angle * angle)


@njit(cache=True)
def _inverse_right_jacobian(
    e: FloatArray, out: FloatArray, products: FloatArray
) -> None:  # pragma: no cover - compiled
    """Write the inverse right Jacobian of SE(3) at a twist (eq. 163, 179, 180); ``products (11, 3, 3)`` is
    scratch.
    """
    P, F, FP, PF, FF, FPF = products[0], products[1], products[2], products[3], products[4], products[5]
    FFP, PFF, FPFF, FFPF, J = products[6], products[7], products[8], products[9], products[10]
    _skew(-e[0], -e[1], -e[2], P)
    _skew(-e[3], -e[4], -e[5], F)
    t2 = e[3] * e[3] + e[4] * e[4] + e[5] * e[5]
    t = math.sqrt(t2)
    b, c, d = 1.0 / 6.0 - t2 / 120.0, 1.0 / 24.0 - t2 / 720.0, 1.0 / 120.0 - t2 / 2520.0
    if t >= _SMALL:
        sine, cosine = math.sin(t), math.cos(t)
        b, c = (t - sine) / (t * t2), (t2 + 2.0 * cosine - 2.0) / (2.0 * t2 * t2)
        d = (2.0 * t - 3.0 * sine + t * cosine) / (2.0 * t2 * t2 * t)
    _multiply(F, P, 1.0, FP, _AXES)
    _multiply(P, F, 1.0, PF, _AXES)
    _multiply(F, F, 1.0, FF, _AXES)
    _multiply(FP, F, 1.0, FPF, _AXES)
    _multiply(F, FP, 1.0, FFP, _AXES)
    _multiply(PF, F, 1.0, PFF, _AXES)
    _multiply(FPF, F, 1.0, FPFF, _AXES)
    _multiply(F, FPF, 1.0, FFPF, _AXES)
    quadratic = _quadratic_coefficient(t)
    for i in range(3):
        for j in range(3):
            P[i, j] = (
                0.5 * P[i, j]
                + b * (FP[i, j] + PF[i, j] + FPF[i, j])
                + c * (FFP[i, j] + PFF[i, j] - 3.0 * FPF[i, j])
                + d * (FPFF[i, j] + FFPF[i, j])
            )
            J[i, j] = (1.0 if i == j else 0.0) - 0.5 * F[i, j] + quadratic * FF[i, j]
    _multiply(J, P, -1.0, FP, _AXES)  # P has become Q
    _multiply(FP, J, 1.0, PF, _AXES)
    for i in range(3):
        for j in range(3):
            out[i, j] = out[3 + i, 3 + j] = J[i, j]
            out[i, 3 + j], out[3 + i, j] = PF[i, j], 0.0


@njit(cache=True)
def _adjoint_of_inverse(T: FloatArray, out: FloatArray) -> None:  # pragma: no cover - compiled
    """Write the adjoint of ``T^-1``: ``[[R', -R' [t]x], [0, R']]`` (eq. 175)."""
    x, y, z = T[0, 3], T[1, 3], T[2, 3]
    for i in range(3):
        u, v, w = T[0, i], T[1, i], T[2, i]
        for j in range(3):
            out[i, j] = out[3 + i, 3 + j] = T[j, i]
            out[3 + i, j] = 0.0
        out[i, 3], out[i, 4], out[i, 5] = cross(x, y, z, u, v, w)


@njit(cache=True)
def _skew(x: float, y: float, z: float, out: FloatArray) -> None:  # pragma: no cover - compiled
    out[0, 0] = out[1, 1] = out[2, 2] = 0.0
    out[0, 1], out[0, 2], out[1, 0] = -z, y, z
    out[1, 2], out[2, 0], out[2, 1] = -x, -y, x


@njit(cache=True)
def _select(full: FloatArray, rows: tuple[int, ...], out: FloatArray) -> None:  # pragma: no cover - compiled
    for i in range(len(rows)):
        for j in range(len(rows)):
            out[i, j] = full[rows[i], rows[j]]


@njit(cache=True)
def _add(A: FloatArray, scale: float, out: FloatArray, rows: tuple[int, ...]) -> None:  # pragma: no cover
    for i in range(len(rows)):
        for j in range(len(rows)):
            out[i, j] += scale * A[i, j]


@njit(cache=True)
def _multiply(
    A: FloatArray, B: FloatArray, scale: float, out: FloatArray, rows: tuple[int, ...]
) -> None:  # pragma: no cover - compiled
    """Write ``scale A B`` of square matrices with as many rows as the tuple."""
    for i in range(len(rows)):
        for j in range(len(rows)):
            value = 0.0
            for k in range(len(rows)):
                value += A[i, k] * B[k, j]
            out[i, j] = scale * value


@njit(cache=True)
def _multiply_transposed(
    A: FloatArray, B: FloatArray, out: FloatArray, rows: tuple[int, ...]
) -> None:  # pragma: no cover - compiled
    """Write ``A' B`` of square matrices with as many rows as the tuple."""
    for i in range(len(rows)):
        for j in range(len(rows)):
            value = 0.0
            for k in range(len(rows)):
                value += A[k, i] * B[k, j]
            out[i, j] = value
