# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Hypotheses of the pose of a map: Kalman update by a candidate, and covariance at another point."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.dfns.raster_matching.interface import RasterMatchingOutputs
from cdff_core.dfpcs.absolute_localisation.hypotheses import Hypothesis

POINT = np.array([10.0, -4.0, 1.0])


def pose(yaw_rad: float, position: list[float]) -> np.ndarray:
    """Return T_orbital_map that moves ``POINT`` to a position."""
    R = se3.exp_so3([0.0, 0.0, yaw_rad])
    return se3.transform(R, np.array(position) - R @ POINT)


def candidates(T: np.ndarray, covariance: np.ndarray) -> RasterMatchingOutputs:
    one = np.array([0.5])
    return RasterMatchingOutputs(
        transforms=T[None],
        covariances=covariance[None],
        correlations=one,
        explained=one,
        log_likelihoods=one,
        centre=POINT,
    )


def test_an_update_is_the_mean_weighted_by_the_inverse_covariances() -> None:
    # Yaw near pi: the mean is between 3.1 rad and -3.1 rad and not zero.
    prior = Hypothesis(pose(3.1, [100.0, 50.0, 5.0]), np.diag([4.0, 1.0, 1.0, 0.01]), POINT)
    measured = pose(-3.1, [103.0, 51.0, 4.0])
    result = prior.updated(candidates(measured, np.diag([4.0, 3.0, 1.0, 0.03])), 0)
    assert result is not None
    np.testing.assert_allclose(result.position, [101.5, 50.25, 4.5])
    assert result.yaw_rad == pytest.approx(3.1 + 0.25 * (2.0 * np.pi - 6.2))
    np.testing.assert_allclose(result.covariance, np.diag([2.0, 0.75, 0.5, 0.0075]), atol=1e-12)
    assert (result.matches, result.explained, result.correlation) == (1, 0.5, 0.5)
    chi2 = 9.0 / 8.0 + 1.0 / 4.0 + 1.0 / 2.0 + (2.0 * np.pi - 6.2) ** 2 / 0.04
    assert result.log_weight == pytest.approx(0.5 - 0.5 * chi2)


def test_a_candidate_that_contradicts_the_hypothesis_does_not_update_it() -> None:
    prior = Hypothesis(pose(0.0, [0.0, 0.0, 0.0]), np.eye(4), POINT)
    assert prior.updated(candidates(pose(0.0, [20.0, 0.0, 0.0]), np.eye(4)), 0) is None


def test_the_error_of_the_yaw_moves_distant_points() -> None:
    yaw_rad, drift = 0.5, np.array([0.1, 0.2, 0.3, 0.0])
    prior = Hypothesis(pose(yaw_rad, [0.0, 0.0, 0.0]), np.diag([1.0, 1.0, 1.0, 1e-4]), POINT)
    # 100 m along the x axis of the map: the variance across is 1e-4 times 100^2.
    moved = prior.at(POINT + np.array([100.0, 0.0, 0.0]), drift)
    across = np.array([-np.sin(yaw_rad), np.cos(yaw_rad)])
    expected = np.diag([1.1, 1.2]) + np.outer(across, across)
    np.testing.assert_allclose(moved.covariance[:2, :2], expected)
    np.testing.assert_allclose(np.diag(moved.covariance)[2:], [1.3, 1e-4])
    np.testing.assert_allclose(moved.position[:2], 100.0 * np.array([np.cos(yaw_rad), np.sin(yaw_rad)]))
    assert moved.sigma_m == pytest.approx(np.sqrt(np.linalg.eigvalsh(expected)[1]))
