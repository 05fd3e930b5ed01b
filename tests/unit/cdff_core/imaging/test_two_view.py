# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two-view models: refinement, covariance, errors of lenses, significance and probabilities of inliers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm

from cdff_common.geometry import se3
from cdff_core.imaging.sampson import sampson
from cdff_core.imaging.two_view import (
    LensErrors,
    _with_covariance,
    fit_essential,
    fit_fundamental,
    fit_homography,
    homography_residuals,
    image_cells,
    inlier_probabilities,
    log10_false_alarms,
    tangents,
    transfer,
)

K = np.array([[500.0, 0.0, 320.0], [0.0, 520.0, 240.0], [0.0, 0.0, 1.0]])
R, T = (
    se3.exp_so3(np.array([0.02, -0.06, 0.03])),
    np.array([0.8, 0.1, -0.2]) / np.linalg.norm([0.8, 0.1, -0.2]),
)
E = se3.skew(T) @ R
F = np.linalg.inv(K).T @ E @ np.linalg.inv(K)


def views(
    n: int, seed: int = 0, *, sigma_px: float = 0.0, plane: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels of random points, or of points on a plane, in both images."""
    rng = np.random.default_rng(seed)
    first = np.column_stack([rng.uniform(20, 620, n), rng.uniform(20, 460, n)])
    rays = np.column_stack([first, np.ones(n)]) @ np.linalg.inv(K).T
    depth = 4.0 / (1.0 + 0.2 * rays[:, 0] - 0.3 * rays[:, 1]) if plane else rng.uniform(3.0, 12.0, n)
    second = (rays * depth[:, None] @ R.T + T) @ K.T
    second = second[:, :2] / second[:, 2:]
    return first + rng.normal(0, sigma_px, (n, 2)), second + rng.normal(0, sigma_px, (n, 2))


def homography() -> np.ndarray:
    """Return the homography ``(3, 3)`` between the images of ``views``, scaled to the Frobenius norm 1."""
    H = K @ (R + np.outer(T, [0.2, -0.3, 1.0]) / 4.0) @ np.linalg.inv(K)
    return np.asarray(H / np.linalg.norm(H))


def angle_rad(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1.0, 1.0)))


def test_an_exact_geometry_is_found_from_a_start_nearby() -> None:
    source, sink = views(120)
    start_R, start_t = se3.exp_so3(np.array([0.002, 0.001, -0.002])) @ R, T + 0.01 * tangents(T)[:, 0]
    fit, found_R, found_t = fit_essential(start_R, start_t, (K, K), source, sink, 3.0, 1.0)
    assert fit.inliers.all()
    assert se3.rotation_angle(found_R @ R.T) < 1e-6
    assert angle_rad(found_t, T) < 1e-6
    start_F = np.linalg.inv(K).T @ se3.skew(start_t) @ start_R @ np.linalg.inv(K)
    of_F = fit_fundamental(start_F, source, sink, 3.0, 1.0)
    assert np.abs(of_F.residuals).max() < 1e-5
    assert np.linalg.det(of_F.matrix) == pytest.approx(0.0, abs=1e-15)
    assert abs(np.sum(of_F.matrix * F) / np.linalg.norm(F)) == pytest.approx(1.0, abs=1e-9)


def test_an_exact_homography_is_found_from_a_start_nearby() -> None:
    source, sink = views(120, plane=True)
    start = homography() + 1e-4 * np.diag([1.0, -1.0, 0.0]) * np.abs(homography()).max()
    fit = fit_homography(start, source, sink, 3.0, 3.0)
    assert fit.inliers.all()
    assert np.abs(fit.residuals).max() < 1e-5
    np.testing.assert_allclose(transfer(fit.matrix, source), sink, atol=1e-5)


@pytest.mark.parametrize("model", ["essential", "fundamental", "homography"])
def test_errors_agree_with_the_covariance_of_the_matrix(model: str) -> None:
    matrices, variances, sigmas = [], [], []
    for seed in range(40):
        source, sink = views(150, seed, sigma_px=0.3, plane=model == "homography")
        if model == "essential":
            fit, _, _ = fit_essential(R, T, (K, K), source, sink, 4.0, 0.5)
        elif model == "fundamental":
            fit = fit_fundamental(F, source, sink, 4.0, 0.5)
        else:
            fit = fit_homography(homography(), source, sink, 4.0, 0.5)
        truth = {"essential": E, "fundamental": F / np.linalg.norm(F), "homography": homography()}[model]
        matrices.append((fit.matrix * np.sign(np.sum(fit.matrix * truth)) - truth).ravel())
        variances.append(np.diagonal(fit.covariance))
        sigmas.append(fit.sigma_px)
        assert np.linalg.matrix_rank(fit.parameters) == len(fit.parameters)
    # Residuals of pairs: errors of both images, per component in the sink for a homography.
    assert np.mean(sigmas) == pytest.approx(0.3, rel=0.06)
    ratio = np.square(matrices).sum(axis=0) / np.sum(variances, axis=0)
    assert (ratio > 0.4).all()
    assert (ratio < 1.7).all()


def test_wrong_pairs_are_no_inliers_and_change_the_result_little() -> None:
    source, sink = views(200, sigma_px=0.2)
    sink[:50] += np.random.default_rng(1).uniform(15.0, 60.0, (50, 2))
    fit, found_R, found_t = fit_essential(R, T, (K, K), source, sink, 3.0, 0.5)
    far = np.abs(sampson(F, source, sink)) > 3.0
    assert not fit.inliers[far].any()
    assert fit.inliers[50:].mean() > 0.95
    assert se3.rotation_angle(found_R @ R.T) < 0.003
    assert angle_rad(found_t, T) < 0.02


@pytest.mark.parametrize(("rows", "excess"), [(1, 25.0 / 30.0), (2, 0.0)])
def test_the_covariance_is_that_of_leave_one_out_residuals_and_larger_for_lines(
    rng: np.random.Generator, rows: int, excess: float
) -> None:
    J, r, D = rng.normal(size=(40, rows, 4)), rng.normal(size=(40, rows)), rng.normal(size=(9, 4))
    inliers = np.arange(40) < 30
    # All in one cell: too few cells for a correlation.
    fit = _with_covariance(np.eye(3), D, J, r, inliers, 0.5, np.zeros(40, np.int64))
    A = J[inliers].reshape(-1, 4)
    inverse = np.linalg.inv(A.T @ A)
    score_products = np.zeros((4, 4))
    for k in range(30):
        leverage = np.mean([row @ inverse @ row for row in J[k]])
        score = J[k].T @ r[k] / (1.0 - leverage)
        score_products += np.outer(score, score)
    parameters = (1.0 + excess) * inverse @ score_products @ inverse
    np.testing.assert_allclose(fit.parameters, parameters, rtol=1e-9)
    np.testing.assert_allclose(fit.covariance, D @ parameters @ D.T, rtol=1e-9)
    assert fit.sigma_px == pytest.approx(np.sqrt((r[inliers] ** 2).sum() / (30 * rows - 4)))


def test_a_model_of_too_few_pairs_has_an_infinite_covariance() -> None:
    source, sink = views(5)
    fit, _, _ = fit_essential(R, T, (K, K), source, sink, 3.0, 1.0)
    assert np.isinf(fit.parameters).all()
    assert np.isinf(fit.covariance).all()


def test_errors_of_the_lenses_enlarge_the_covariance_by_their_effect_on_the_result() -> None:
    source, sink = views(300)
    lenses = LensErrors(axis_rad=2e-4, edge_px=0.05)
    without, *_ = fit_essential(R, T, (K, K), source, sink, 4.0, 1.0)
    with_lenses, *_ = fit_essential(R, T, (K, K), source, sink, 4.0, 1.0, lenses)
    effects = []
    for first, second in ((1.0, 0.0), (0.0, 1.0)):
        moves = zip(
            lenses.displacements(source, K).transpose(2, 0, 1),
            lenses.displacements(sink, K).transpose(2, 0, 1),
            strict=True,
        )
        for of_source, of_sink in moves:
            _, moved_R, moved_t = fit_essential(
                R, T, (K, K), source + first * of_source, sink + second * of_sink, 10.0, 1.0
            )
            rotation = se3.log_se3(se3.transform(moved_R @ R.T, np.zeros(3)))[3:]
            effects.append(np.r_[rotation, tangents(T).T @ moved_t])
    expected = np.transpose(effects) @ np.array(effects)
    added = with_lenses.parameters - without.parameters
    np.testing.assert_allclose(np.diagonal(added), np.diagonal(expected), rtol=0.05)


def test_displacements_by_the_axis_are_those_of_a_rotated_camera_and_by_the_edge_the_stated_pixels() -> None:
    points = np.array([[20.0, 240.0], [620.0, 240.0], [320.0, 540.0], [400.0, 300.0]])
    moved = LensErrors(1e-6, 0.5).displacements(points, K)
    rays = np.column_stack([points, np.ones(4)]) @ np.linalg.inv(K).T
    for columns, rotation in (((0, 2), [0.0, 1e-6, 0.0]), ((1, 3), [-1e-6, 0.0, 0.0])):
        turned = rays @ se3.exp_so3(np.array(rotation)).T @ K.T
        expected = turned[:, :2] / turned[:, 2:] - points
        np.testing.assert_allclose(moved[:, :, columns].sum(axis=2), expected, rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(moved[:, 0, 0], 500.0 * 1e-6)
    np.testing.assert_allclose(moved[:, 1, 1], 520.0 * 1e-6)
    right, below = moved[1], moved[2]  # at 300 px from the centre
    np.testing.assert_allclose(right[:, 4:], [[0.5, 0.0, 0.0, 0.5], [0.0, 0.0, 0.25, 0.0]], atol=1e-12)
    np.testing.assert_allclose(below[:, 4:], [[0.0, 0.0, 0.25, 0.0], [0.0, 0.5, 0.0, 0.5]], atol=1e-12)


def test_points_at_the_horizon_of_a_homography_have_a_large_residual() -> None:
    H = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.01, 0.0, -1.0]])
    points = np.array([[100.0, 50.0], [50.0, 50.0]])
    residuals = homography_residuals(H, points, points)
    assert (residuals[0] == 1e6).all()
    np.testing.assert_allclose(residuals[1], [-150.0 / np.sqrt(2.0), -150.0 / np.sqrt(2.0)])


def test_tangents_are_an_orthonormal_basis_perpendicular_to_the_direction() -> None:
    basis = np.column_stack([T, tangents(T)])
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-12)


def test_cells_divide_the_points_into_eight_rows_and_columns() -> None:
    x, y = np.meshgrid(np.arange(17.0), np.arange(33.0))
    cells = image_cells(np.column_stack([x.ravel() + 5.0, y.ravel() - 3.0]))
    expected = 8 * np.minimum(y // 4, 7) + np.minimum(x // 2, 7)
    np.testing.assert_array_equal(cells, expected.ravel())


@pytest.mark.parametrize(("pairs", "inliers", "minimal"), [(100, 20, 7), (100, 9, 7), (40, 40, 4)])
def test_false_alarms_are_the_expected_models_among_random_pairs(
    pairs: int, inliers: int, minimal: int
) -> None:
    chance = 0.03
    models = (pairs - minimal) * math.comb(pairs, inliers) * math.comb(inliers, minimal)
    expected = math.log10(models) + (inliers - minimal) * math.log10(chance)
    assert log10_false_alarms(pairs, inliers, chance, minimal) == pytest.approx(expected)


def test_a_minimal_sample_is_never_significant() -> None:
    assert log10_false_alarms(100, 7, 1e-9, 7) == math.inf
    assert log10_false_alarms(100, 8, 1e-9, 7) < math.inf


@pytest.mark.parametrize(("sigma_px", "fraction", "span_px"), [(0.3, 0.8, 50.0), (2.0, 0.4, 10.0)])
def test_the_probability_of_an_inlier_follows_from_bayes(
    sigma_px: float, fraction: float, span_px: float
) -> None:
    residuals = np.array([0.0, 0.5, -1.0, 3.0, 20.0])
    inlier = fraction * norm.pdf(residuals, scale=sigma_px)
    expected = inlier / (inlier + (1.0 - fraction) / span_px)
    np.testing.assert_allclose(inlier_probabilities(residuals, sigma_px, fraction, span_px), expected)


def test_without_noise_only_exact_matches_are_inliers() -> None:
    probabilities = inlier_probabilities(np.array([0.0, 1e-3]), 0.0, 0.5, 100.0)
    np.testing.assert_allclose(probabilities, [1.0, 0.0], atol=1e-6)
