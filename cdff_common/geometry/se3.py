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

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError

FloatArray = NDArray[np.float64]

_SMALL_RAD = 1e-7
_EYE, _LAST_ROW = np.eye(3), np.array([0.0, 0.0, 0.0, 1.0])


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
    theta = np.linalg.norm(a, axis=-1)[..., None, None]
    K = skew(a)
    small = theta < _SMALL_RAD
    safe = np.where(small, 1.0, theta)
    s = np.where(small, 1.0 - theta**2 / 6.0, np.sin(safe) / safe)
    c = np.where(small, 0.5 - theta**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    return np.asarray(np.eye(3) + s * K + c * (K @ K), dtype=np.float64)


def log_so3(R: ArrayLike) -> FloatArray:
    """Rotation vectors ``(..., 3)``, radians in [0, pi], of rotation matrices ``(..., 3, 3)``."""
    q = quaternion_xyzw_from_matrix(R)
    return rotation_vector_from_quaternion_xyzw(q)


def rotation_vector_from_quaternion_xyzw(q_xyzw: ArrayLike) -> FloatArray:
    """Rotation vectors ``(..., 3)``, radians, of unit quaternions ``(..., 4)`` in x, y, z, w order."""
    q = np.asarray(q_xyzw, dtype=np.float64)
    q = np.where(q[..., 3:] < 0.0, -q, q)
    v, w = q[..., :3], q[..., 3]
    n = np.linalg.norm(v, axis=-1)
    angle = 2.0 * np.arctan2(n, w)
    scale = np.where(n < _SMALL_RAD, 2.0, angle / np.where(n < _SMALL_RAD, 1.0, n))
    return np.asarray(v * scale[..., None], dtype=np.float64)


def quaternion_xyzw_from_matrix(R: ArrayLike) -> FloatArray:
    """Unit quaternions ``(..., 4)``, x, y, z, w with w >= 0, of rotation matrices ``(..., 3, 3)``."""
    m = np.asarray(R, dtype=np.float64)
    d0, d1, d2 = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    # Bar-Itzhack's largest-of-four choice: the biggest component is found from the diagonal, the rest from sums.
    q2 = np.stack([1 + d0 - d1 - d2, 1 - d0 + d1 - d2, 1 - d0 - d1 + d2, 1 + d0 + d1 + d2], axis=-1)
    best = np.argmax(q2, axis=-1)
    candidates = np.stack(
        [
            np.stack(
                [q2[..., 0], m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] - m[..., 1, 2]], -1
            ),
            np.stack(
                [m[..., 1, 0] + m[..., 0, 1], q2[..., 1], m[..., 2, 1] + m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0]], -1
            ),
            np.stack(
                [m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2], q2[..., 2], m[..., 1, 0] - m[..., 0, 1]], -1
            ),
            np.stack(
                [m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1], q2[..., 3]], -1
            ),
        ],
        axis=-2,
    )
    q = np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.asarray(np.where(q[..., 3:] < 0.0, -q, q), dtype=np.float64)


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
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    rows = [
        np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], -1),
        np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], -1),
        np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], -1),
    ]
    return np.stack(rows, axis=-2)


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
    return np.asarray(np.linalg.norm(log_so3(R), axis=-1), dtype=np.float64)


def is_transform(T: ArrayLike, tolerance: float = 1e-6) -> bool:
    """Tell whether a ``(4, 4)`` array is a finite rigid transform within ``tolerance``."""
    m = np.asarray(T, dtype=np.float64)
    if m.shape != (4, 4) or not np.all(np.isfinite(m)):
        return False
    R = m[:3, :3]
    # Not np.allclose: it takes ten times as long, and every transform that is made is looked at.
    off = max(float(np.abs(m[3] - _LAST_ROW).max()), float(np.abs(R @ R.T - _EYE).max()))
    return off <= tolerance and float(np.linalg.det(R)) > 0.0
