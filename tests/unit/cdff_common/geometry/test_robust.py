# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Robust estimates against closed forms, minimisation on a grid, and least squares of the correct pairs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, norm

from cdff_common.geometry import se3
from cdff_common.geometry.robust import (
    chi_squared_quantile,
    graduated_fit,
    median_sigma,
    rigid_fit,
    truncated_weights,
)

T_TRUE = se3.transform(se3.exp_so3([0.3, -0.2, 0.9]), [1.0, -2.0, 0.5])


def noisy_pairs(rng: np.random.Generator, n: int, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    source = rng.uniform(-5.0, 5.0, (n, 3))
    return source, se3.transform_points(T_TRUE, source) + rng.normal(0.0, sigma, (n, 3))


@pytest.mark.parametrize("probability", [0.5, 0.95, 0.999])
@pytest.mark.parametrize("freedoms", [1, 3, 6])
def test_the_quantile_is_that_of_scipy(probability: float, freedoms: int) -> None:
    assert chi_squared_quantile(probability, freedoms) == pytest.approx(chi2.ppf(probability, freedoms))


def test_the_scale_of_gaussian_residuals_is_their_standard_deviation() -> None:
    quantiles = 3.0 * norm.ppf((np.arange(1001) + 0.5) / 1001)
    assert median_sigma(quantiles) == pytest.approx(3.0, rel=2e-3)


@pytest.mark.parametrize("mu", [1e-2, 0.7, 40.0])
def test_weights_minimise_the_relaxed_loss(mu: float) -> None:
    limit = 2.5
    squares = np.concatenate([np.linspace(0.01, 8.0, 30), limit * np.array([mu / (mu + 1), (mu + 1) / mu])])
    grid = np.linspace(0.0, 1.0, 20_001)
    penalty = mu * (1.0 - grid) / (mu + grid) * limit  # Yang et al. (2020), equation (12)
    best = grid[np.argmin(grid * squares[:, None] + penalty, axis=1)]
    np.testing.assert_allclose(truncated_weights(squares, limit, mu), best, atol=1e-3)


def test_the_fit_is_stationary_in_the_weighted_squares(rng: np.random.Generator) -> None:
    source, target = noisy_pairs(rng, 30, 0.2)
    weights = rng.uniform(0.1, 4.0, 30)
    T = rigid_fit(source, target, weights)

    def cost(T: np.ndarray) -> float:
        return float(weights @ np.sum((se3.transform_points(T, source) - target) ** 2, axis=1))

    for axis in np.eye(6):
        gradient = (cost(T @ se3.exp_se3(1e-5 * axis)) - cost(T @ se3.exp_se3(-1e-5 * axis))) / 2e-5
        assert abs(gradient) < 1e-5
        assert cost(T @ se3.exp_se3(0.01 * axis)) > cost(T)


def test_the_fit_of_mirrored_points_is_a_rotation(rng: np.random.Generator) -> None:
    source = rng.normal(size=(20, 3))
    R = rigid_fit(source, source * [1.0, 1.0, -1.0], np.ones(20))[:3, :3]
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_wrong_pairs_have_no_influence(rng: np.random.Generator) -> None:
    source, target = noisy_pairs(rng, 40, 0.02)
    target[:12] += rng.uniform(1.0, 6.0, (12, 3))
    T, squares = graduated_fit(source, target, 0.15)
    expected = rigid_fit(source[12:], target[12:], np.ones(28))
    np.testing.assert_allclose(T, expected, atol=1e-9)
    np.testing.assert_allclose(squares, np.sum((se3.transform_points(T, source) - target) ** 2, axis=1))
    assert (squares[:12] > 0.15**2).all()
    assert (squares[12:] < 0.15**2).all()


def test_pairs_within_the_limit_are_fitted_by_least_squares(rng: np.random.Generator) -> None:
    source, target = noisy_pairs(rng, 25, 0.2)
    T, squares = graduated_fit(source, target, 2.0)
    np.testing.assert_allclose(T, rigid_fit(source, target, np.ones(25)), atol=1e-12)
    assert squares.max() < 4.0


def test_squares_and_weights_are_those_of_the_variances(rng: np.random.Generator) -> None:
    source, target = noisy_pairs(rng, 30, 0.1)
    sigmas = rng.uniform(0.05, 0.5, 30)
    T, squares = graduated_fit(source, target, 50.0, sigmas)
    np.testing.assert_allclose(T, rigid_fit(source, target, sigmas**-2.0), atol=1e-12)
    residuals = se3.transform_points(T, source) - target
    np.testing.assert_allclose(squares, np.sum(residuals**2, axis=1) / sigmas**2)


def test_pairs_of_which_fewer_than_three_agree_have_infinite_squares() -> None:
    source = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]])
    target = np.array([[0.0, 0, 0], [40, 0, 0], [0, 90, 0], [0, 0, 200]])
    _, squares = graduated_fit(source, target, 1e-3)
    assert np.isinf(squares).all()
    assert squares.shape == (4,)


def test_three_pairs_that_agree_are_sufficient() -> None:
    source = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    target = se3.transform_points(T_TRUE, source)
    target[3] += [0.0, 0.0, 3.0]
    T, squares = graduated_fit(source, target, 0.05)
    np.testing.assert_allclose(T, T_TRUE, atol=1e-6)
    assert np.isfinite(squares).all()
