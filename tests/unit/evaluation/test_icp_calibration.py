# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The calibration estimates the factors by which the estimated covariances are too small."""

from __future__ import annotations

import numpy as np
import pytest

from evaluation.icp_calibration import inflations


def test_the_factors_are_computed_from_errors_and_estimated_covariances(rng: np.random.Generator) -> None:
    entries = []
    for _ in range(400):
        L = np.tril(rng.normal(size=(6, 6))) * 0.3 + np.eye(6)
        estimated = 1e-6 * L @ L.T
        scale = np.diag(np.sqrt([9.0] * 3 + [100.0] * 3))
        entries.append((rng.multivariate_normal(np.zeros(6), scale @ estimated @ scale), estimated))
    assert inflations(entries) == pytest.approx((9.0, 100.0), rel=0.15)
