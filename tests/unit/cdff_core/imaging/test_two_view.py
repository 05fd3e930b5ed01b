# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Probabilities of inliers of a mixture of Gaussian and uniform residuals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from cdff_core.imaging.two_view import inlier_probabilities


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
