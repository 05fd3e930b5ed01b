# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SO(3) and SE(3) on numpy arrays: the only Lie algebra in the tree.

``T_a_b`` maps coordinates in b into coordinates in a: ``p_a = T_a_b @ p_b``, ``T_a_c = T_a_b @ T_b_c``.
Functions take one element or a stack: rotations ``(..., 3, 3)``, transforms ``(..., 4, 4)``,
tangents ``(..., 3)`` or ``(..., 6)`` in the order ``[x y z rx ry rz]``.

References
----------
.. [1] Solà, J., Deray, J., Atchuthan, D. (2018). A micro Lie theory for state estimation in robotics. arXiv:1812.01537
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError

FloatArray = NDArray[np.float64]

#: Added to what is divided by: below it, sin(t)/t and the like are at their limits.
_TINY = 1e-300
_EYE = np.eye(3)


def skew(v: ArrayLike) -> FloatArray:
    """Return the cross-product matrices of vectors.

    Parameters
    ----------
    v : array_like, shape (..., 3)

    Returns
    -------
    NDArray[np.float64], shape (..., 3, 3)
        ``skew(v) @ w == cross(v, w)``.
    """
    a = np.asarray(v, dtype=np.float64)
    out = np.zeros((*a.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -a[..., 2], a[..., 1]
    out[..., 1, 0], out[..., 1, 2] = a[..., 2], -a[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -a[..., 1], a[..., 0]
    return out


def exp_so3(phi: ArrayLike) -> FloatArray:
    """Rotation matrices ``(..., 3, 3)`` of rotation vectors ``(..., 3)`` in radians (Rodrigues, [1]_ eq. 134)."""
    a = np.asarray(phi, dtype=np.float64)
    half = 0.5 * np.sqrt((a * a).sum(axis=-1))[..., None, None] + _TINY
    K = skew(a)
    s, c = np.sin(2.0 * half) / (2.0 * half), 0.5 * (np.sin(half) / half) ** 2
    return np.asarray(_EYE + s * K + c * (K @ K), dtype=np.float64)


def log_so3(R: ArrayLike) -> FloatArray:
    """Rotation vectors ``(..., 3)``, radians in [0, pi], of rotation matrices ``(..., 3, 3)``."""
    q = quaternion_xyzw_from_matrix(R)
    return rotation_vector_from_quaternion_xyzw(q)


def rotation_vector_from_quaternion_xyzw(q_xyzw: ArrayLike) -> FloatArray:
    """Rotation vectors ``(..., 3)``, radians, of unit quaternions ``(..., 4)`` in x, y, z, w order."""
    q = np.asarray(q_xyzw, dtype=np.float64)
    v, w = q[..., :3], q[..., 3:]
    n = np.sqrt((v * v).sum(axis=-1, keepdims=True)) + _TINY
    # Of the quaternion and its negative the one with w >= 0: a turn by at most pi.
    return np.asarray(np.where(w < 0.0, -2.0, 2.0) * np.arctan2(n, np.abs(w)) / n * v, dtype=np.float64)


def quaternion_xyzw_from_matrix(R: ArrayLike) -> FloatArray:
    """Unit quaternions ``(..., 4)``, x, y, z, w with w >= 0, of rotation matrices ``(..., 3, 3)``."""
    m = np.asarray(R, dtype=np.float64)
    mt = np.swapaxes(m, -1, -2)
    trace = (m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2])[..., None, None]
    # 4 q q^T: each row is the quaternion times one of its components, and that with the largest is the most exact.
    Q = np.empty((*m.shape[:-2], 4, 4))
    Q[..., :3, :3] = m + mt + (1.0 - trace) * _EYE
    Q[..., 3, :3] = Q[..., :3, 3] = (m - mt)[..., (2, 0, 1), (1, 2, 0)]
    Q[..., 3:, 3:] = 1.0 + trace
    rows = Q.reshape(-1, 4, 4)
    q = rows[np.arange(len(rows)), rows[:, range(4), range(4)].argmax(axis=1)]
    q *= (np.where(q[:, 3] < 0.0, -1.0, 1.0) / np.sqrt((q * q).sum(axis=1)))[:, None]
    return np.asarray(q.reshape(*m.shape[:-2], 4), dtype=np.float64)


def matrix_from_quaternion_xyzw(q_xyzw: ArrayLike) -> FloatArray:
    """Rotation matrices ``(..., 3, 3)`` of quaternions ``(..., 4)`` in x, y, z, w order, normalised first.

    Raises
    ------
    InputError
        If a quaternion has a norm that is zero or not finite.
    """
    q = np.asarray(q_xyzw, dtype=np.float64)
    n = np.linalg.norm(q, axis=-1, keepdims=True)
    if not np.all(np.isfinite(n)) or np.any(n < 1e-12):
        raise InputError(f"quaternion {q.tolist()}: expected four finite numbers with a norm above 0")
    q = q / n
    v, w = q[..., :3], q[..., 3, None, None]
    return np.asarray((2.0 * w * w - 1.0) * _EYE + 2.0 * (v[..., :, None] * v[..., None, :] + w * skew(v)))


def left_jacobian_so3(phi: ArrayLike) -> FloatArray:
    """Left Jacobians ``(..., 3, 3)`` of SO(3) at rotation vectors ``(..., 3)`` ([1]_ eq. 145)."""
    a = np.asarray(phi, dtype=np.float64)
    theta = np.linalg.norm(a, axis=-1)[..., None, None]
    K = skew(a)
    small = theta < 1e-4
    safe = np.where(small, 1.0, theta)
    b = np.where(small, 0.5 - theta**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    c = np.where(small, 1.0 / 6.0 - theta**2 / 120.0, (safe - np.sin(safe)) / safe**3)
    return np.asarray(np.eye(3) + b * K + c * (K @ K), dtype=np.float64)


def transform(R: ArrayLike, t: ArrayLike) -> FloatArray:
    """Transforms ``(..., 4, 4)`` of rotations ``(..., 3, 3)`` and translations ``(..., 3)`` in metres."""
    r, v = np.asarray(R, dtype=np.float64), np.asarray(t, dtype=np.float64)
    out = np.zeros((*np.broadcast_shapes(r.shape[:-2], v.shape[:-1]), 4, 4))
    out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = r, v, 1.0
    return out


def transform_from_quaternion_xyzw(t: ArrayLike, q_xyzw: ArrayLike) -> FloatArray:
    """Transforms ``(..., 4, 4)`` of translations ``(..., 3)`` in metres and quaternions ``(..., 4)`` x, y, z, w."""
    return transform(matrix_from_quaternion_xyzw(q_xyzw), t)


def exp_se3(xi: ArrayLike) -> FloatArray:
    """Transforms ``(..., 4, 4)`` of twists ``(..., 6)`` ``[x y z rx ry rz]`` ([1]_ eq. 172)."""
    a = np.asarray(xi, dtype=np.float64)
    V = left_jacobian_so3(a[..., 3:])
    return transform(exp_so3(a[..., 3:]), (V @ a[..., :3, None])[..., 0])


def log_se3(T: ArrayLike) -> FloatArray:
    """Twists ``(..., 6)`` ``[x y z rx ry rz]`` of transforms ``(..., 4, 4)``."""
    m = np.asarray(T, dtype=np.float64)
    phi = log_so3(m[..., :3, :3])
    rho = np.linalg.solve(left_jacobian_so3(phi), m[..., :3, 3:])[..., 0]
    return np.concatenate([rho, phi], axis=-1)


def adjoint(T: ArrayLike) -> FloatArray:
    """Adjoints ``(..., 6, 6)`` of transforms ``(..., 4, 4)``: ``T Exp(x) T^-1 == Exp(adjoint(T) @ x)`` ([1]_ 175)."""
    m = np.asarray(T, dtype=np.float64)
    R = m[..., :3, :3]
    out = np.zeros((*m.shape[:-2], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = R
    out[..., :3, 3:] = skew(m[..., :3, 3]) @ R
    return out


def inverse_right_jacobian_se3(xi: ArrayLike) -> FloatArray:
    """Inverse right Jacobians ``(..., 6, 6)`` of SE(3) at twists ``(..., 6)`` ([1]_ eq. 163, 179 to 180).

    ``Log(Exp(xi) Exp(x)) = xi + inverse_right_jacobian_se3(xi) @ x`` to first order in x.
    """
    a = -np.asarray(xi, dtype=np.float64)
    P, F = skew(a[..., :3]), skew(a[..., 3:])
    theta = np.linalg.norm(a[..., 3:], axis=-1)[..., None, None]
    small = theta < 1e-2
    t = np.where(small, 1.0, theta)
    b = np.where(small, 1.0 / 6.0 - theta**2 / 120.0, (t - np.sin(t)) / t**3)
    c = np.where(small, 1.0 / 24.0 - theta**2 / 720.0, (t**2 + 2.0 * np.cos(t) - 2.0) / (2.0 * t**4))
    d = np.where(small, 1.0 / 120.0 - theta**2 / 2520.0, (2.0 * t - 3.0 * np.sin(t) + t * np.cos(t)) / (2.0 * t**5))
    FP, PF = F @ P, P @ F
    FPF = FP @ F
    Q = 0.5 * P + b * (FP + PF + FPF) + c * (F @ FP + PF @ F - 3.0 * FPF) + d * (FPF @ F + F @ FPF)
    inverse_left = np.linalg.inv(left_jacobian_so3(a[..., 3:]))
    out = np.zeros((*a.shape[:-1], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = inverse_left
    out[..., :3, 3:] = -inverse_left @ Q @ inverse_left
    return out


def inverse(T: ArrayLike) -> FloatArray:
    """Inverse transforms: ``T_b_a`` of ``T_a_b``, shape (..., 4, 4)."""
    m = np.asarray(T, dtype=np.float64)
    Rt = np.swapaxes(m[..., :3, :3], -1, -2)
    return transform(Rt, -(Rt @ m[..., :3, 3:])[..., 0])


def transform_points(T_a_b: ArrayLike, points_b: ArrayLike) -> FloatArray:
    """Map points ``(n, 3)`` in b into a by one transform ``(4, 4)``; metres in, metres out."""
    T = np.asarray(T_a_b, dtype=np.float64)
    p = np.asarray(points_b, dtype=np.float64)
    return np.asarray(p @ T[:3, :3].T + T[:3, 3], dtype=np.float64)


def normalise_rotation(R: ArrayLike) -> FloatArray:
    """Nearest rotation matrices ``(..., 3, 3)`` in the Frobenius norm (SVD)."""
    U, _, Vt = np.linalg.svd(np.asarray(R, dtype=np.float64))
    d = np.sign(np.linalg.det(U @ Vt))
    U = U.copy()
    U[..., :, 2] *= d[..., None]
    return np.asarray(U @ Vt, dtype=np.float64)


def rotation_angle(R: ArrayLike) -> FloatArray:
    """Angles ``(...)`` in radians of rotation matrices ``(..., 3, 3)``."""
    m = np.asarray(R, dtype=np.float64)
    double_sine = (m - np.swapaxes(m, -1, -2))[..., (2, 0, 1), (1, 2, 0)]
    double_cosine = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2] - 1.0
    return np.asarray(np.arctan2(np.sqrt((double_sine**2).sum(axis=-1)), double_cosine), dtype=np.float64)


def is_transform(T: ArrayLike, tolerance: float = 1e-6) -> bool:
    """Tell whether a ``(4, 4)`` array is a finite rigid transform within ``tolerance``."""
    m = np.asarray(T, dtype=np.float64)
    if m.shape != (4, 4):
        return False
    # In scalars: every transform that is made is looked at, and numpy takes ten times as long over a matrix this small.
    (a, b, c, x), (d, e, f, y), (g, h, i, z), (k, m, n, one) = m.tolist()
    if not math.isfinite(x + y + z):
        return False
    errors = (
        a * a + b * b + c * c - 1.0, d * d + e * e + f * f - 1.0, g * g + h * h + i * i - 1.0,
        a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i, k, m, n, one - 1.0,
    )  # fmt: skip
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return determinant > 0.0 and all(-tolerance <= error <= tolerance for error in errors)
