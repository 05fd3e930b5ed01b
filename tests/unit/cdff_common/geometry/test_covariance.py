# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Covariance conventions, checked against sampling."""

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3

SAMPLES = 20_000


def perturbed(T: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """``t + dt``, ``Exp(phi) R``: the model of the module, for errors (n, 6)."""
    return se3.transform(se3.exp_so3(errors[:, 3:]) @ T[:3, :3], T[:3, 3] + errors[:, :3])


def errors_of(T: np.ndarray, samples: np.ndarray) -> np.ndarray:
    return np.concatenate([samples[:, :3, 3] - T[:3, 3], se3.log_so3(samples[:, :3, :3] @ T[:3, :3].T)], axis=1)


@pytest.fixture
def two(rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    out = []
    for _ in range(2):
        A = rng.normal(size=(6, 6)) * 0.01
        out += [se3.exp_se3(rng.normal(size=6)), A @ A.T]
    return tuple(out)


def test_composition_agrees_with_sampling(two: tuple[np.ndarray, ...], rng: np.random.Generator) -> None:
    A, cov_a, B, cov_b = two
    samples = perturbed(A, rng.multivariate_normal(np.zeros(6), cov_a, SAMPLES)) @ perturbed(
        B, rng.multivariate_normal(np.zeros(6), cov_b, SAMPLES)
    )
    sampled = np.cov(errors_of(A @ B, samples).T)
    assert np.allclose(cov.compose_covariance(A, cov_a, B, cov_b), sampled, atol=0.06 * np.abs(sampled).max())


def test_inversion_agrees_with_sampling(two: tuple[np.ndarray, ...], rng: np.random.Generator) -> None:
    A, cov_a, _, _ = two
    samples = se3.inverse(perturbed(A, rng.multivariate_normal(np.zeros(6), cov_a, SAMPLES)))
    sampled = np.cov(errors_of(se3.inverse(A), samples).T)
    assert np.allclose(cov.inverse_covariance(A, cov_a), sampled, atol=0.06 * np.abs(sampled).max())


def test_inverting_twice_gives_the_covariance_back(two: tuple[np.ndarray, ...]) -> None:
    A, cov_a, _, _ = two
    twice = cov.inverse_covariance(se3.inverse(A), cov.inverse_covariance(A, cov_a))
    assert np.allclose(twice, cov_a, atol=1e-12)


def test_point_covariance_agrees_with_sampling(two: tuple[np.ndarray, ...], rng: np.random.Generator) -> None:
    A, cov_a, _, _ = two
    point = np.array([2.0, -1.0, 0.5])
    samples = perturbed(A, rng.multivariate_normal(np.zeros(6), cov_a, SAMPLES))
    sampled = np.cov((samples[:, :3, :3] @ point + samples[:, :3, 3]).T)
    assert np.allclose(cov.point_covariance(A, cov_a, point[None])[0], sampled, atol=0.06 * np.abs(sampled).max())


def test_rotation_first_order_is_swapped_and_swapped_back(two: tuple[np.ndarray, ...]) -> None:
    swapped = cov.swap_rotation_translation(two[1])
    assert np.allclose(swapped[:3, :3], two[1][3:, 3:])
    assert np.array_equal(cov.swap_rotation_translation(swapped), two[1])


def test_pose_error_is_what_the_covariance_describes() -> None:
    T = se3.exp_se3([1, 2, 3, 0.1, 0.2, 0.3])
    error = np.array([0.1, -0.2, 0.3, 0.01, 0.02, -0.03])
    assert np.allclose(cov.pose_error(perturbed(T, error[None])[0], T), error)


@pytest.mark.parametrize(
    ("matrix", "fault"),
    [
        (np.zeros((3, 3)), "shape"),
        (np.full((6, 6), np.nan), "finite"),
        (-np.eye(6), "eigenvalue"),
        (np.eye(6) + np.triu(np.ones((6, 6)), 1), "symmetric"),
    ],
)
def test_a_matrix_that_is_no_covariance_is_refused(matrix: np.ndarray, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        cov.checked_covariance(matrix)
