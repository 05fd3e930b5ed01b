# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Covariance conventions, compared with sampling."""

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3

SAMPLES = 20_000


def perturbed(T: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Apply errors (n, 6) to a pose with the error model of the module: ``t + dt``, ``Exp(phi) R``."""
    return se3.transform(se3.exp_so3(errors[:, 3:]) @ T[:3, :3], T[:3, 3] + errors[:, :3])


def errors_of(T: np.ndarray, samples: np.ndarray) -> np.ndarray:
    return np.concatenate(
        [samples[:, :3, 3] - T[:3, 3], se3.log_so3(samples[:, :3, :3] @ T[:3, :3].T)], axis=1
    )


@pytest.fixture
def two_poses(rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    out = []
    for _ in range(2):
        A = rng.normal(size=(6, 6)) * 0.01
        out += [se3.exp_se3(rng.normal(size=6)), A @ A.T]
    return tuple(out)


def test_composition_agrees_with_sampling(
    two_poses: tuple[np.ndarray, ...], rng: np.random.Generator
) -> None:
    A, cov_a, B, cov_b = two_poses
    samples = perturbed(A, rng.multivariate_normal(np.zeros(6), cov_a, SAMPLES)) @ perturbed(
        B, rng.multivariate_normal(np.zeros(6), cov_b, SAMPLES)
    )
    sampled = np.cov(errors_of(A @ B, samples).T)
    assert np.allclose(cov.compose_covariance(A, cov_a, B, cov_b), sampled, atol=0.06 * np.abs(sampled).max())


def test_inversion_agrees_with_sampling(two_poses: tuple[np.ndarray, ...], rng: np.random.Generator) -> None:
    A, cov_a, _, _ = two_poses
    samples = se3.inverse(perturbed(A, rng.multivariate_normal(np.zeros(6), cov_a, SAMPLES)))
    sampled = np.cov(errors_of(se3.inverse(A), samples).T)
    assert np.allclose(cov.inverse_covariance(A, cov_a), sampled, atol=0.06 * np.abs(sampled).max())


def test_jacobians_of_a_relative_motion_agree_with_finite_differences(
    two_poses: tuple[np.ndarray, ...],
) -> None:
    A, _, B, _ = two_poses
    J_first, J_second = cov.relative_jacobians(A, B)
    motion, steps = se3.inverse(A) @ B, 1e-6 * np.eye(6)
    by_first = errors_of(motion, se3.inverse(perturbed(A, steps)) @ B).T / 1e-6
    by_second = errors_of(motion, se3.inverse(A) @ perturbed(B, steps)).T / 1e-6
    np.testing.assert_allclose(J_first, by_first, atol=1e-5)
    np.testing.assert_allclose(J_second, by_second, atol=1e-5)


def test_stacked_poses_give_the_same_result_as_single_poses(two_poses: tuple[np.ndarray, ...]) -> None:
    A, cov_a, B, cov_b = two_poses
    stack = cov.compose_covariance(np.array([A, B]), np.array([cov_a, cov_b]), np.array([B, A]), cov_b)
    np.testing.assert_allclose(stack[0], cov.compose_covariance(A, cov_a, B, cov_b))
    np.testing.assert_allclose(stack[1], cov.compose_covariance(B, cov_b, A, cov_b))
    inverted = cov.inverse_covariance(np.array([A, B]), np.array([cov_a, cov_b]))
    np.testing.assert_allclose(inverted[1], cov.inverse_covariance(B, cov_b))


def test_information_is_the_inverse_and_an_exact_pose_has_infinite_information(
    two_poses: tuple[np.ndarray, ...],
) -> None:
    np.testing.assert_allclose(
        cov.information_from_covariance(two_poses[1]) @ two_poses[1], np.eye(6), atol=1e-6
    )
    np.testing.assert_allclose(cov.information_from_covariance(np.zeros((6, 6)), 0.1), 100.0 * np.eye(6))


def test_the_nearest_semidefinite_matrix_has_no_negative_eigenvalue(
    two_poses: tuple[np.ndarray, ...],
) -> None:
    nearest = cov.nearest_semidefinite(two_poses[1] - np.trace(two_poses[1]) / 6.0 * np.eye(6))
    assert np.linalg.eigvalsh(nearest)[0] > -1e-12
    np.testing.assert_allclose(cov.nearest_semidefinite(two_poses[1]), two_poses[1], atol=1e-12)


def test_inverting_twice_restores_the_covariance(two_poses: tuple[np.ndarray, ...]) -> None:
    A, cov_a, _, _ = two_poses
    twice = cov.inverse_covariance(se3.inverse(A), cov.inverse_covariance(A, cov_a))
    assert np.allclose(twice, cov_a, atol=1e-12)


def test_rotation_first_order_is_converted_in_both_directions(two_poses: tuple[np.ndarray, ...]) -> None:
    swapped = cov.swap_rotation_translation(two_poses[1])
    assert np.allclose(swapped[:3, :3], two_poses[1][3:, 3:])
    assert np.array_equal(cov.swap_rotation_translation(swapped), two_poses[1])


def test_the_pose_error_uses_the_convention_of_the_covariance() -> None:
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
def test_an_invalid_covariance_is_refused(matrix: np.ndarray, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        cov.checked_covariance(matrix)
