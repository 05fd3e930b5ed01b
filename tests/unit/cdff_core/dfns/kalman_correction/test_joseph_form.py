# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""JosephForm: the least squares of state and measurement, or a refusal."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.kalman_correction._interface import KalmanCorrectionInputs, KalmanCorrectionOutputs


def corrected(*inputs: np.ndarray, **config: float) -> KalmanCorrectionOutputs:
    node = Registry.default().make_dfn("kalman_correction")
    node.configure(config)
    return node.process(KalmanCorrectionInputs(*inputs))


def problem(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    A, B = rng.normal(size=(5, 5)), rng.normal(size=(2, 2))
    return 0.1 * rng.normal(size=2), rng.normal(size=(2, 5)), B @ B.T + np.eye(2), A @ A.T + np.eye(5)


def test_it_is_the_least_squares_solution(rng: np.random.Generator) -> None:
    r, H, N, P = problem(rng)
    out = corrected(r, H, N, P)
    information = np.linalg.inv(P) + H.T @ np.linalg.inv(N) @ H
    np.testing.assert_allclose(out.covariance, np.linalg.inv(information), atol=1e-9)
    np.testing.assert_allclose(out.correction, np.linalg.solve(information, H.T @ np.linalg.solve(N, r)), atol=1e-9)
    assert float(out.innovation) == pytest.approx(r @ np.linalg.solve(H @ P @ H.T + N, r))


def test_the_covariance_stays_symmetric_and_positive_where_a_measurement_is_nearly_exact(
    rng: np.random.Generator,
) -> None:
    r, H, _, P = problem(rng)
    C = corrected(r, H, 1e-12 * np.eye(2), P, gate_probability=0.9999999).covariance
    np.testing.assert_array_equal(C, C.T)
    assert np.linalg.eigvalsh(C)[0] > -1e-9


def test_a_contradiction_is_refused_by_its_innovation(rng: np.random.Generator) -> None:
    _, H, N, P = problem(rng)
    with pytest.raises(RefusedError) as refusal:
        corrected(np.array([1e3, 0.0]), H, N, P)
    assert refusal.value.reasons[0].startswith("innovation:")


def test_arrays_that_do_not_fit_are_refused(rng: np.random.Generator) -> None:
    r, H, N, P = problem(rng)
    with pytest.raises(InputError, match="jacobian"):
        corrected(r, H[:, :4], N, P)
