# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SO(3) and SE(3) on numpy arrays: the only Lie algebra of the framework.

``T_a_b`` maps coordinates in b into coordinates in a: ``p_a = T_a_b @ p_b``, ``T_a_c = T_a_b @ T_b_c``.
Functions take one element or a stack: rotations ``(..., 3, 3)``, transforms ``(..., 4, 4)``,
tangents ``(..., 3)`` or ``(..., 6)`` in the order ``[x y z rx ry rz]``. ``[v]x`` is the cross-product matrix.

References
----------
.. [1] Solà, J., Deray, J., Atchuthan, D. (2018). A micro Lie theory for state estimation in robotics.
  arXiv:1812.01537
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError

FloatArray = NDArray[np.float64]

#: Added to denominators: at this size sin(t)/t and similar quotients have reached their limits.
_TINY = 1e-300
_EYE = np.eye(3)


def skew(v: ArrayLike) -> FloatArray:
    """Return the cross-product matrices ``[v]x`` of vectors ``(..., 3)``, shape (..., 3, 3).

    ``[v]x = [[0, -z, y], [z, 0, -x], [-y, x, 0]]``, so that ``skew(v) @ w == cross(v, w)``.
    """
    a = np.asarray(v, dtype=np.float64)
    out = np.zeros((*a.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -a[..., 2], a[..., 1]
    out[..., 1, 0], out[..., 1, 2] = a[..., 2], -a[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -a[..., 1], a[..., 0]
    return out


def exp_so3(phi: ArrayLike) -> FloatArray:
    """Return the rotation matrices ``(..., 3, 3)`` of rotation vectors ``(..., 3)`` in radians.

    Rodrigues' formula ([1]_ eq. 134): ``Exp(phi) = I + sin(t)/t [phi]x + (1 - cos(t))/t^2 [phi]x^2``,
    ``t = |phi|``.

    See Also
    --------
    log_so3 : Inverse function.
    """
    a = np.asarray(phi, dtype=np.float64)
    half = 0.5 * np.sqrt((a * a).sum(axis=-1))[..., None, None] + _TINY
    K = skew(a)
    s, c = np.sin(2.0 * half) / (2.0 * half), 0.5 * (np.sin(half) / half) ** 2
    return np.asarray(_EYE + s * K + c * (K @ K), dtype=np.float64)


def log_so3(R: ArrayLike) -> FloatArray:
    """Return the rotation vectors ``(..., 3)``, of length 0 to pi radians, of rotations ``(..., 3, 3)``.

    See Also
    --------
    exp_so3 : Inverse function.
    """
    q = quaternion_xyzw_from_matrix(R)
    return rotation_vector_from_quaternion_xyzw(q)


def rotation_vector_from_quaternion_xyzw(q_xyzw: ArrayLike) -> FloatArray:
    """Return the rotation vectors ``(..., 3)``, radians, of unit quaternions ``(..., 4)`` x, y, z, w.

    ``phi = 2 atan2(|v|, w) v / |v|`` for ``q = (v, w)`` ([1]_ eq. 133).
    """
    q = np.asarray(q_xyzw, dtype=np.float64)
    v, w = q[..., :3], q[..., 3:]
    n = np.sqrt((v * v).sum(axis=-1, keepdims=True)) + _TINY
    # q and -q are the same rotation; the one with w >= 0 has an angle of at most pi.
    return np.asarray(np.where(w < 0.0, -2.0, 2.0) * np.arctan2(n, np.abs(w)) / n * v, dtype=np.float64)


def quaternion_xyzw_from_matrix(R: ArrayLike) -> FloatArray:
    """Return the unit quaternions ``(..., 4)``, x, y, z, w with w >= 0, of rotations ``(..., 3, 3)``."""
    m = np.asarray(R, dtype=np.float64)
    mt = np.swapaxes(m, -1, -2)
    trace = (m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2])[..., None, None]
    # 4 q q^T: each row is the quaternion times one of its components; the largest component is most accurate.
    Q = np.empty((*m.shape[:-2], 4, 4))
    Q[..., :3, :3] = m + mt + (1.0 - trace) * _EYE
    Q[..., 3, :3] = Q[..., :3, 3] = (m - mt)[..., (2, 0, 1), (1, 2, 0)]
    Q[..., 3:, 3:] = 1.0 + trace
    rows = Q.reshape(-1, 4, 4)
    q = rows[np.arange(len(rows)), rows[:, range(4), range(4)].argmax(axis=1)]
    q *= (np.where(q[:, 3] < 0.0, -1.0, 1.0) / np.sqrt((q * q).sum(axis=1)))[:, None]
    return np.asarray(q.reshape(*m.shape[:-2], 4), dtype=np.float64)


def matrix_from_quaternion_xyzw(q_xyzw: ArrayLike) -> FloatArray:
    """Return the rotation matrices ``(..., 3, 3)`` of quaternions ``(..., 4)`` x, y, z, w, after
    normalisation.

    ``R = (2 w^2 - 1) I + 2 (v v^T + w [v]x)`` for ``q = (v, w)``.

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
    """Return the left Jacobians ``(..., 3, 3)`` of SO(3) at rotation vectors ``(..., 3)`` ([1]_ eq. 145).

    ``J_l = I + (1 - cos(t))/t^2 [phi]x + (t - sin(t))/t^3 [phi]x^2``, ``t = |phi|``.
    """
    a = np.asarray(phi, dtype=np.float64)
    theta = np.linalg.norm(a, axis=-1)[..., None, None]
    K = skew(a)
    small = theta < 1e-4
    safe = np.where(small, 1.0, theta)
    b = np.where(small, 0.5 - theta**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    c = np.where(small, 1.0 / 6.0 - theta**2 / 120.0, (safe - np.sin(safe)) / safe**3)
    return np.asarray(np.eye(3) + b * K + c * (K @ K), dtype=np.float64)


def transform(R: ArrayLike, t: ArrayLike) -> FloatArray:
    """Return the transforms ``(..., 4, 4)`` of rotations ``(..., 3, 3)`` and translations ``(..., 3)``,
    metres.
    """
    r, v = np.asarray(R, dtype=np.float64), np.asarray(t, dtype=np.float64)
    out = np.zeros((*np.broadcast_shapes(r.shape[:-2], v.shape[:-1]), 4, 4))
    out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = r, v, 1.0
    return out


def transform_from_quaternion_xyzw(t: ArrayLike, q_xyzw: ArrayLike) -> FloatArray:
    """Return the transforms ``(..., 4, 4)`` of translations ``(..., 3)``, metres, and quaternions ``(...,
    4)``.
    """
    return transform(matrix_from_quaternion_xyzw(q_xyzw), t)


def exp_se3(xi: ArrayLike) -> FloatArray:
    """Return the transforms ``(..., 4, 4)`` of twists ``(..., 6)`` ``[rho phi]``.

    ``Exp([rho phi]) = [[Exp(phi), J_l(phi) rho], [0, 1]]`` ([1]_ eq. 172).

    See Also
    --------
    log_se3 : Inverse function.
    transform_from_vector : Translation and rotation vector, without the Jacobian.
    """
    a = np.asarray(xi, dtype=np.float64)
    V = left_jacobian_so3(a[..., 3:])
    return transform(exp_so3(a[..., 3:]), (V @ a[..., :3, None])[..., 0])


def log_se3(T: ArrayLike) -> FloatArray:
    """Return the twists ``(..., 6)`` ``[rho phi]`` of transforms ``(..., 4, 4)``.

    ``phi = Log(R)``, ``rho = J_l(phi)^-1 t`` ([1]_ eq. 173).

    See Also
    --------
    exp_se3 : Inverse function.
    """
    m = np.asarray(T, dtype=np.float64)
    phi = log_so3(m[..., :3, :3])
    rho = np.linalg.solve(left_jacobian_so3(phi), m[..., :3, 3:])[..., 0]
    return np.concatenate([rho, phi], axis=-1)


def transform_from_vector(vector: ArrayLike) -> FloatArray:
    """Return the transforms ``(..., 4, 4)`` of a translation and a rotation vector ``(..., 6)``.

    ``[[Exp(phi), t], [0, 1]]`` of ``[t phi]``: a tangent of R^3 x SO(3), as pose covariances use it.

    See Also
    --------
    exp_se3 : The same for twists, a tangent of SE(3).
    """
    v = np.asarray(vector, dtype=np.float64)
    return transform(exp_so3(v[..., 3:]), v[..., :3])


def vector_from_transform(T: ArrayLike) -> FloatArray:
    """Return translation and rotation vector ``[t Log(R)]``, shape (..., 6), of transforms."""
    m = np.asarray(T, dtype=np.float64)
    return np.concatenate([m[..., :3, 3], log_so3(m[..., :3, :3])], axis=-1)


def inverse(T: ArrayLike) -> FloatArray:
    """Return the inverse transforms ``T_b_a = [[R^T, -R^T t], [0, 1]]``, shape (..., 4, 4)."""
    m = np.asarray(T, dtype=np.float64)
    Rt = np.swapaxes(m[..., :3, :3], -1, -2)
    return transform(Rt, -(Rt @ m[..., :3, 3:])[..., 0])


def transform_points(T_a_b: ArrayLike, points_b: ArrayLike) -> FloatArray:
    """Return points ``(n, 3)`` in a, metres, of points in b: ``p_a = R p_b + t``."""
    T = np.asarray(T_a_b, dtype=np.float64)
    p = np.asarray(points_b, dtype=np.float64)
    return np.asarray(p @ T[:3, :3].T + T[:3, 3], dtype=np.float64)


def normalise_rotation(R: ArrayLike) -> FloatArray:
    """Return the nearest rotation matrices ``(..., 3, 3)`` in the Frobenius norm: ``U diag(1, 1, d) V^T``."""
    U, _, Vt = np.linalg.svd(np.asarray(R, dtype=np.float64))
    d = np.sign(np.linalg.det(U @ Vt))
    U = U.copy()
    U[..., :, 2] *= d[..., None]
    return np.asarray(U @ Vt, dtype=np.float64)


def normalise_transform(T: ArrayLike) -> FloatArray:
    """Return transforms ``(..., 4, 4)`` with the nearest rotations, to remove rounding of long products."""
    m = np.asarray(T, dtype=np.float64)
    return transform(normalise_rotation(m[..., :3, :3]), m[..., :3, 3])


def interpolate_transform(first: ArrayLike, second: ArrayLike, fraction: float) -> FloatArray:
    """Interpolate between transforms ``(4, 4)``: translation linearly, rotation along the geodesic.

    ``R = R_0 Exp(s Log(R_0^T R_1))``, ``t = (1 - s) t_0 + s t_1``.
    """
    A, B = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    R = A[:3, :3] @ exp_so3(fraction * log_so3(A[:3, :3].T @ B[:3, :3]))
    return transform(normalise_rotation(R), (1.0 - fraction) * A[:3, 3] + fraction * B[:3, 3])


def rotation_angle(R: ArrayLike) -> FloatArray:
    """Return the angles ``(...)``, radians, of rotation matrices ``(..., 3, 3)``."""
    m = np.asarray(R, dtype=np.float64)
    double_sine = (m - np.swapaxes(m, -1, -2))[..., (2, 0, 1), (1, 2, 0)]
    double_cosine = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2] - 1.0
    return np.asarray(np.arctan2(np.sqrt((double_sine**2).sum(axis=-1)), double_cosine), dtype=np.float64)


def is_transform(T: ArrayLike, tolerance: float = 1e-6) -> bool:
    """Return whether a ``(4, 4)`` array is a finite rigid transform within ``tolerance``."""
    m = np.asarray(T, dtype=np.float64)
    if m.shape != (4, 4):
        return False
    # Scalars: every transform is checked, and numpy takes ten times as long for a matrix this small.
    (a, b, c, x), (d, e, f, y), (g, h, i, z), (k, m, n, one) = m.tolist()
    if not math.isfinite(x + y + z):
        return False
    errors = (
        a * a + b * b + c * c - 1.0,
        d * d + e * e + f * f - 1.0,
        g * g + h * h + i * i - 1.0,
        a * d + b * e + c * f,
        a * g + b * h + c * i,
        d * g + e * h + f * i,
        k,
        m,
        n,
        one - 1.0,
    )
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return determinant > 0.0 and all(-tolerance <= error <= tolerance for error in errors)


def are_transforms(T: ArrayLike, tolerance: float = 1e-6) -> NDArray[np.bool_]:
    """Return whether each of the ``(n, 4, 4)`` arrays is a finite rigid transform within ``tolerance``."""
    m = np.asarray(T, dtype=np.float64)
    R = m[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        errors = np.abs(R @ np.swapaxes(R, 1, 2) - _EYE).max(axis=(1, 2), initial=0.0)
        last_row = np.abs(m[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1, initial=0.0)
        determinant = np.einsum("ni,ni->n", R[:, 0], np.cross(R[:, 1], R[:, 2]))
    is_finite = np.isfinite(m).all(axis=(1, 2))
    return np.asarray(is_finite & (errors <= tolerance) & (last_row <= tolerance) & (determinant > 0.0))
