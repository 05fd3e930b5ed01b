# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Covariance of poses: one convention, its propagation, and the one permutation to solvers that differ.

A covariance of ``T_a_b`` is 6x6 in the order ``[x y z rx ry rz]``, metres and radians. The perturbation is in the
parent frame a, on R3 x SO(3): ``t_true = t + dt``, ``R_true = Exp(phi) R``, as ROS reads it. Error of two different
transforms is taken as independent unless said otherwise.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from cdff_common.errors import InputError
from cdff_common.geometry.se3 import FloatArray, log_so3, skew

#: Row and column order that turns [rx ry rz x y z] (GTSAM, small_gicp) into [x y z rx ry rz], and back.
ROTATION_FIRST = np.array([3, 4, 5, 0, 1, 2])
_EYE = np.eye(6)


def swap_rotation_translation(covariance: ArrayLike) -> FloatArray:
    """Permute a ``(..., 6, 6)`` matrix between rotation-first and translation-first order (its own inverse)."""
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
        raise InputError(f"{name}: holds values that are not finite; leave it out where it is unknown")
    asymmetry = float(np.abs(c - c.T).max())
    if asymmetry > 1e-6 * scale:
        raise InputError(f"{name}: not symmetric (largest difference {asymmetry:.3g})")
    c = 0.5 * (c + c.T)
    try:
        # It succeeds where no eigenvalue is below what is allowed for, in half the time that they take.
        np.linalg.cholesky(c + max(1e-9 * scale, 1e-300) * _EYE)
    except np.linalg.LinAlgError:
        raise InputError(f"{name}: smallest eigenvalue {np.linalg.eigvalsh(c)[0]:.3g}, expected none below 0") from None
    return c


def compose_covariance(T_a_b: ArrayLike, cov_a_b: ArrayLike, T_b_c: ArrayLike, cov_b_c: ArrayLike) -> FloatArray:
    """Covariance ``(6, 6)`` of ``T_a_c = T_a_b @ T_b_c``, first order, the two errors independent."""
    J1, J2 = compose_jacobians(T_a_b, T_b_c)
    return np.asarray(J1 @ np.asarray(cov_a_b) @ J1.T + J2 @ np.asarray(cov_b_c) @ J2.T, dtype=np.float64)


def compose_jacobians(T_a_b: ArrayLike, T_b_c: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """How the errors of ``T_a_b`` and of ``T_b_c`` show in ``T_a_b @ T_b_c``: two ``(6, 6)``."""
    Tab, Tbc = np.asarray(T_a_b, dtype=np.float64), np.asarray(T_b_c, dtype=np.float64)
    R = Tab[:3, :3]
    J1 = np.eye(6)
    J1[:3, 3:] = -skew(R @ Tbc[:3, 3])
    J2 = np.zeros((6, 6))
    J2[:3, :3] = J2[3:, 3:] = R
    return J1, J2


def inverse_covariance(T_a_b: ArrayLike, cov_a_b: ArrayLike) -> FloatArray:
    """Covariance ``(6, 6)`` of ``T_b_a = inverse(T_a_b)``, perturbation in frame b."""
    J = inverse_jacobian(T_a_b)
    return np.asarray(J @ np.asarray(cov_a_b) @ J.T, dtype=np.float64)


def inverse_jacobian(T_a_b: ArrayLike) -> FloatArray:
    """How the error of ``T_a_b`` shows in ``inverse(T_a_b)``: ``(6, 6)``."""
    T = np.asarray(T_a_b, dtype=np.float64)
    Rt = T[:3, :3].T
    J = np.zeros((6, 6))
    J[:3, :3] = -Rt
    J[:3, 3:] = -Rt @ skew(T[:3, 3])
    J[3:, 3:] = -Rt
    return J


def pose_error(T_true: ArrayLike, T_estimated: ArrayLike) -> FloatArray:
    """Error vector ``(6,)`` in the convention of this module: what the covariance is the covariance of."""
    Tt, Te = np.asarray(T_true, dtype=np.float64), np.asarray(T_estimated, dtype=np.float64)
    return np.concatenate([Tt[:3, 3] - Te[:3, 3], log_so3(Tt[:3, :3] @ Te[:3, :3].T)])


def from_right_perturbation(T_a_b: ArrayLike, cov_b: ArrayLike) -> FloatArray:
    """Covariance in our convention from one of ``T_true = T Exp([rho phi])`` (body frame, GTSAM after swapping)."""
    R = np.asarray(T_a_b, dtype=np.float64)[:3, :3]
    J = np.zeros((6, 6))
    J[:3, :3] = J[3:, 3:] = R
    return np.asarray(J @ np.asarray(cov_b) @ J.T, dtype=np.float64)


def point_covariance(T_a_b: ArrayLike, cov_a_b: ArrayLike, points_b: ArrayLike) -> FloatArray:
    """Covariance ``(n, 3, 3)`` in a, square metres, that a pose's covariance puts on points ``(n, 3)`` in b."""
    T = np.asarray(T_a_b, dtype=np.float64)
    p_a = np.asarray(points_b, dtype=np.float64) @ T[:3, :3].T
    J = np.zeros((len(p_a), 3, 6))
    J[:, :, :3] = np.eye(3)
    J[:, :, 3:] = -skew(p_a)
    return np.asarray(J @ np.asarray(cov_a_b) @ np.swapaxes(J, 1, 2), dtype=np.float64)
