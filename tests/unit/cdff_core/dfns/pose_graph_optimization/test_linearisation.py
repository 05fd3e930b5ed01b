# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Normal equations of a pose graph agree with series of SE(3), for small and large angles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import bernoulli, factorial

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.dfns.pose_graph_optimization._linearisation import accumulate, squared_errors

ROWS = tuple(range(6))


def _inverse_right_jacobian(twist: FloatArray) -> FloatArray:
    """Return the series ``sum B_n / n! (-ad)^n``, which converges for angles below 2 pi."""
    ad = np.block([[se3.skew(twist[3:]), se3.skew(twist[:3])], [np.zeros((3, 3)), se3.skew(twist[3:])]])
    orders = np.arange(80)
    coefficients = bernoulli(79) / factorial(orders)
    return sum(c * np.linalg.matrix_power(-ad, n) for n, c in zip(orders, coefficients, strict=True))


def _adjoint(T: FloatArray) -> FloatArray:
    R = T[:3, :3]
    return np.block([[R, se3.skew(T[:3, 3]) @ R], [np.zeros((3, 3)), R]])


@pytest.mark.parametrize("scale", [1e-6, 0.005, 0.3, 1.0])
@pytest.mark.parametrize("is_a_later", [False, True])
def test_errors_gradient_and_hessian_of_an_edge(
    rng: np.random.Generator, scale: float, is_a_later: bool
) -> None:
    poses = se3.exp_se3(rng.normal(size=(2, 6)))
    between = se3.inverse(poses[0]) @ poses[1]
    measured = (between @ se3.exp_se3(scale * rng.normal(size=6)))[None]
    root = rng.normal(size=(6, 6))
    W = (root @ root.T)[None]
    a, b = np.array([0]), np.array([1])
    e = se3.log_se3(se3.inverse(measured[0]) @ between)
    Jb = _inverse_right_jacobian(e)
    Ja = -Jb @ _adjoint(se3.inverse(between))
    assert squared_errors(poses, a, b, measured, W, ROWS)[0] == pytest.approx(e @ W[0] @ e)

    position = np.array([1, 0]) if is_a_later else np.array([0, 1])
    diagonal, lower, gradient = np.zeros((2, 6, 6)), np.zeros((1, 6, 6)), np.zeros((2, 6))
    accumulate(
        poses,
        a,
        b,
        measured,
        W,
        np.array([2.0]),
        ROWS,
        position,
        np.array([0]),
        np.array([is_a_later]),
        diagonal,
        lower,
        gradient,
    )
    first, second = position
    tolerance = 1e-9 * np.abs(W).max() * max(1.0, np.abs(Ja).max() ** 2)
    for actual, expected in (
        (diagonal[first], Ja.T @ W[0] @ Ja),
        (diagonal[second], Jb.T @ W[0] @ Jb),
        (lower[0], (Ja.T if is_a_later else Jb.T) @ W[0] @ (Jb if is_a_later else Ja)),
        (gradient[first], Ja.T @ W[0] @ e),
        (gradient[second], Jb.T @ W[0] @ e),
    ):
        np.testing.assert_allclose(actual, 2.0 * expected, atol=tolerance)


def test_the_error_of_a_half_turn_has_length_pi() -> None:
    poses = se3.transform(np.array([np.eye(3), np.diag([-1.0, 1.0, -1.0])]), np.zeros((2, 3)))
    squared = squared_errors(poses, np.array([0]), np.array([1]), np.eye(4)[None], np.eye(6)[None], ROWS)
    assert squared[0] == pytest.approx(np.pi**2)
