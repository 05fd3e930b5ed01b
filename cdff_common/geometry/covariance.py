# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Covariance of poses: one error convention, its propagation, and the conversion to solvers with another
order.

A covariance of ``T_a_b`` is 6x6 in the order ``[x y z rx ry rz]``, metres and radians. The error is expressed
in the parent frame a, on R^3 x SO(3), as in ROS (REP 103, ``geometry_msgs/PoseWithCovariance``)::

    t_true = t + dt,    R_true = Exp(phi) R,    C = E[(dt, phi) (dt, phi)^T]

Errors of two different transforms are independent unless stated otherwise. Functions take one matrix or a
stack: transforms ``(..., 4, 4)``, covariances ``(..., 6, 6)``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from cdff_common.errors import InputError
from cdff_common.geometry.se3 import FloatArray, log_so3, skew

#: Row and column order that converts [rx ry rz x y z] (GTSAM, small_gicp) to [x y z rx ry rz], and back.
ROTATION_FIRST = np.array([3, 4, 5, 0, 1, 2])
_EYE = np.eye(6)


def swap_rotation_translation(covariance: ArrayLike) -> FloatArray:
    """Permute ``(..., 6, 6)`` matrices between rotation-first and translation-first order (self-inverse)."""
    c = np.asarray(covariance, dtype=np.float64)
    return c[..., ROTATION_FIRST[:, None], ROTATION_FIRST[None, :]]


def checked_covariance(covariance: ArrayLike, name: str = "covariance") -> FloatArray:
    """Return a symmetric copy of a 6x6 covariance.

    Raises
    ------
    InputError
        If it is not 6x6, finite, symmetric and positive semi-definite (within rounding).
    """
    c = np.asarray(covariance, dtype=np.float64)
    if c.shape != (6, 6):
        raise InputError(f"{name}: shape {c.shape}, expected (6, 6) in the order [x y z rx ry rz]")
    scale = float(np.abs(c).max())
    if not math.isfinite(scale):
        raise InputError(f"{name}: contains values that are not finite; omit it if it is unknown")
    asymmetry = float(np.abs(c - c.T).max())
    if asymmetry > 1e-6 * scale:
        raise InputError(f"{name}: not symmetric (largest difference {asymmetry:.3g})")
    c = 0.5 * (c + c.T)
    try:
        # Cholesky is twice as fast as eigenvalues; the diagonal term is the tolerated rounding error.
        np.linalg.cholesky(c + max(1e-9 * scale, 1e-300) * _EYE)
    except np.linalg.LinAlgError:
        raise InputError(
            f"{name}: smallest eigenvalue {np.linalg.eigvalsh(c)[0]:.3g}, expected none below 0"
        ) from None
    return c


def symmetrised(matrix: ArrayLike) -> FloatArray:
    """Return the symmetric part ``(M + M^T) / 2`` of matrices ``(..., n, n)``."""
    m = np.asarray(matrix, dtype=np.float64)
    return np.asarray(0.5 * (m + np.swapaxes(m, -1, -2)))


def nearest_semidefinite(matrix: ArrayLike) -> FloatArray:
    """Return the nearest symmetric positive semi-definite matrix ``(n, n)`` in the Frobenius norm.

    The negative eigenvalues of the symmetric part are set to zero (Higham 1988,
    doi:10.1016/0024-3795(88)90223-6, theorem 2.1).
    """
    values, vectors = np.linalg.eigh(symmetrised(matrix))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T, dtype=np.float64)


def information_from_covariance(covariance: ArrayLike, least_sigma: float = 0.0) -> FloatArray:
    """Return the information matrices ``(..., 6, 6)``, symmetric: ``(C + least_sigma^2 I)^-1``.

    Parameters
    ----------
    covariance : array_like, shape (..., 6, 6)
    least_sigma : float
        Standard deviation added to each component (metres, radians), so that an exact pose has an inverse.
    """
    c = np.asarray(covariance, dtype=np.float64)
    return symmetrised(np.linalg.inv(c + least_sigma**2 * _EYE))


def rotation_blocks(R: ArrayLike) -> FloatArray:
    """Return ``diag(R, R)``, shape (..., 6, 6), of rotations ``(..., 3, 3)``.

    It expresses an error ``[dt phi]`` in other axes: ``(R dt, R phi)``.

    See Also
    --------
    rotate_covariance : Apply it to a covariance.
    """
    r = np.asarray(R, dtype=np.float64)
    out = np.zeros((*r.shape[:-2], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = r
    return out


def rotate_covariance(covariance: ArrayLike, R_a_b: ArrayLike) -> FloatArray:
    """Express covariances (or information matrices) in other axes: ``diag(R, R) C diag(R, R)^T``.

    Parameters
    ----------
    covariance : array_like, shape (..., 6, 6)
        Covariance of an error in axes b.
    R_a_b : array_like, shape (..., 3, 3)

    Returns
    -------
    NDArray[np.float64], shape (..., 6, 6)
        Covariance of the same error in axes a. With ``R`` of ``T_a_b`` this also converts the covariance of a
        right perturbation, ``T_true = T Exp([rho phi])`` (GTSAM, after ``swap_rotation_translation``), to the
        convention of this module.
    """
    J = rotation_blocks(R_a_b)
    return np.asarray(J @ np.asarray(covariance) @ np.swapaxes(J, -1, -2), dtype=np.float64)


def compose_covariance(
    T_a_b: ArrayLike, cov_a_b: ArrayLike, T_b_c: ArrayLike, cov_b_c: ArrayLike
) -> FloatArray:
    """Return the covariances ``(..., 6, 6)`` of ``T_a_c = T_a_b T_b_c`` for independent errors, to first
    order.

    ``C_a_c = J1 C_a_b J1^T + J2 C_b_c J2^T`` with the Jacobians of ``compose_jacobians``.
    """
    J1, J2 = compose_jacobians(T_a_b, T_b_c)
    first = J1 @ np.asarray(cov_a_b) @ np.swapaxes(J1, -1, -2)
    return np.asarray(first + J2 @ np.asarray(cov_b_c) @ np.swapaxes(J2, -1, -2), dtype=np.float64)


def compose_jacobians(T_a_b: ArrayLike, T_b_c: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the Jacobians ``(..., 6, 6)`` of the error of ``T_a_b T_b_c`` with respect to the errors
    of ``T_a_b`` and ``T_b_c``.

    ``J1 = [[I, -[R_a_b t_b_c]x], [0, I]]`` and ``J2 = diag(R_a_b, R_a_b)``.

    See Also
    --------
    relative_jacobians : Jacobians of the inverse composition.
    """
    Tab, Tbc = np.asarray(T_a_b, dtype=np.float64), np.asarray(T_b_c, dtype=np.float64)
    R = Tab[..., :3, :3]
    lever_a = (R @ Tbc[..., :3, 3:])[..., 0]
    J1 = np.zeros((*lever_a.shape[:-1], 6, 6)) + _EYE
    J1[..., :3, 3:] = -skew(lever_a)
    return J1, rotation_blocks(R)


def inverse_covariance(T_a_b: ArrayLike, cov_a_b: ArrayLike) -> FloatArray:
    """Return the covariances ``(..., 6, 6)`` of ``T_b_a = inverse(T_a_b)``, errors in frame b."""
    J = inverse_jacobian(T_a_b)
    return np.asarray(J @ np.asarray(cov_a_b) @ np.swapaxes(J, -1, -2), dtype=np.float64)


def inverse_jacobian(T_a_b: ArrayLike) -> FloatArray:
    """Return the Jacobians ``(..., 6, 6)`` of the error of ``inverse(T_a_b)`` with respect to the error of
    ``T_a_b``.

    ``J = -[[R^T, R^T [t]x], [0, R^T]]``.
    """
    T = np.asarray(T_a_b, dtype=np.float64)
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    J = -rotation_blocks(Rt)
    J[..., :3, 3:] = -Rt @ skew(T[..., :3, 3])
    return J


def relative_jacobians(T_a_b: ArrayLike, T_a_c: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the Jacobians ``(..., 6, 6)`` of the error of ``T_b_c = T_a_b^-1 T_a_c`` with respect to the
    errors of both poses.

    ``J_b = [[-R^T, R^T [t_a_c - t_a_b]x], [0, -R^T]]`` and ``J_c = diag(R^T, R^T)`` with ``R = R_a_b``. For
    poses with cross-covariance ``X = E[e_c e_b^T]``, the covariance of the motion is
    ``J_b C_b J_b^T + J_c C_c J_c^T + J_c X J_b^T + (J_c X J_b^T)^T``.

    See Also
    --------
    compose_jacobians : Jacobians of the composition ``T_a_b T_b_c``.
    """
    Tab, Tac = np.asarray(T_a_b, dtype=np.float64), np.asarray(T_a_c, dtype=np.float64)
    Rt = np.swapaxes(Tab[..., :3, :3], -1, -2)
    Jc = rotation_blocks(Rt)
    Jb = -Jc
    Jb[..., :3, 3:] = Rt @ skew(Tac[..., :3, 3] - Tab[..., :3, 3])
    return Jb, Jc


def pose_error(T_true: ArrayLike, T_estimated: ArrayLike) -> FloatArray:
    """Return the errors ``(..., 6)`` in the convention of this module: ``[t_true - t, Log(R_true R^T)]``."""
    Tt, Te = np.asarray(T_true, dtype=np.float64), np.asarray(T_estimated, dtype=np.float64)
    phi = log_so3(Tt[..., :3, :3] @ np.swapaxes(Te[..., :3, :3], -1, -2))
    return np.concatenate([Tt[..., :3, 3] - Te[..., :3, 3], phi], axis=-1)
