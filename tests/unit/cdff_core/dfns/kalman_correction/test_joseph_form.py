# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Kalman correction in Joseph form: the least-squares solution of state and measurement, or a refusal."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.kalman_correction.interface import KalmanCorrectionInputs, KalmanCorrectionOutputs


def correct(
    residual: np.ndarray, jacobian: np.ndarray, noise: np.ndarray, covariance: np.ndarray, **config: float
) -> KalmanCorrectionOutputs:
    node = Registry.default().make_dfn("kalman_correction")
    node.configure(config)
    return node.process(
        KalmanCorrectionInputs(residual=residual, jacobian=jacobian, noise=noise, covariance=covariance)
    )


def problem(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    A, B = rng.normal(size=(5, 5)), rng.normal(size=(2, 2))
    return 0.1 * rng.normal(size=2), rng.normal(size=(2, 5)), B @ B.T + np.eye(2), A @ A.T + np.eye(5)


def test_the_result_is_the_least_squares_solution(rng: np.random.Generator) -> None:
    r, H, N, P = problem(rng)
    out = correct(r, H, N, P)
    information = np.linalg.inv(P) + H.T @ np.linalg.inv(N) @ H
    np.testing.assert_allclose(out.covariance, np.linalg.inv(information), atol=1e-9)
    np.testing.assert_allclose(
        out.correction, np.linalg.solve(information, H.T @ np.linalg.solve(N, r)), atol=1e-9
    )
    assert out.innovation == pytest.approx(r @ np.linalg.solve(H @ P @ H.T + N, r))


def test_the_covariance_stays_symmetric_positive_definite_for_a_nearly_exact_measurement(
    rng: np.random.Generator,
) -> None:
    r, H, _, P = problem(rng)
    C = correct(r, H, 1e-12 * np.eye(2), P, gate_probability=0.9999999).covariance
    np.testing.assert_array_equal(C, C.T)
    assert np.linalg.eigvalsh(C)[0] > -1e-9


def test_a_contradicting_measurement_is_refused_by_its_innovation(rng: np.random.Generator) -> None:
    _, H, N, P = problem(rng)
    with pytest.raises(RefusedError) as refusal:
        correct(np.array([1e3, 0.0]), H, N, P)
    assert refusal.value.reasons[0].startswith("innovation:")


def test_arrays_of_inconsistent_shape_are_refused(rng: np.random.Generator) -> None:
    r, H, N, P = problem(rng)
    with pytest.raises(InputError, match="jacobian"):
        correct(r, H[:, :4], N, P)


def test_considered_errors_are_not_corrected_but_keep_their_correlations(rng: np.random.Generator) -> None:
    r, H, N, P = problem(rng)
    node = Registry.default().make_dfn("kalman_correction")
    node.configure()
    out = node.process(
        KalmanCorrectionInputs(residual=r, jacobian=H, noise=N, covariance=P, considered=np.array([3]))
    )
    assert out.correction[3] == 0.0
    assert out.covariance[3, 3] == pytest.approx(P[3, 3])
    K = out.gain
    joseph = (np.eye(5) - K @ H) @ P @ (np.eye(5) - K @ H).T + K @ N @ K.T
    np.testing.assert_allclose(out.covariance, joseph, atol=1e-9)
