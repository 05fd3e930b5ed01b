# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mean and covariance by adaptive importance sampling: densities whose moments are known."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_core.object_models.importance import mean_and_covariance


def estimated(mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the estimate for a normal density, whose first proposal is the unit density around 0."""
    information = np.linalg.inv(covariance)

    def energy(points: FloatArray) -> FloatArray:
        offset = points - mean
        return np.asarray(0.5 * np.einsum("ki,ij,kj->k", offset, information, offset))

    n = len(mean)
    return mean_and_covariance(
        energy, np.zeros(n), np.eye(n), rounds=6, samples=400, rng=np.random.default_rng(3)
    )


def test_the_moments_of_a_correlated_normal_density_are_found() -> None:
    mean, covariance = np.array([0.8, -0.5]), np.array([[0.5, 0.3], [0.3, 0.4]])
    found_mean, found = estimated(mean, covariance)
    np.testing.assert_allclose(found_mean, mean, atol=0.05)
    np.testing.assert_allclose(found, covariance, atol=0.05)


def test_a_density_much_narrower_than_the_first_proposal_is_found() -> None:
    mean, covariance = np.array([1.5, -1.0, 0.5]), np.diag([0.05, 0.2, 0.02]) ** 2
    found_mean, found = estimated(mean, covariance)
    np.testing.assert_allclose(found_mean, mean, atol=0.05)
    # A constant variance of 0.001 is added.
    np.testing.assert_allclose(np.diag(found), np.diag(covariance) + 0.001, rtol=0.35)
