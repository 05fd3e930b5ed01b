# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The calibration finds the factors by which stated covariances were too small."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_dev.evaluate.icp_calibration import inflations


def test_the_factors_are_found_from_errors_and_what_was_stated(rng: np.random.Generator) -> None:
    entries = []
    for _ in range(400):
        L = np.tril(rng.normal(size=(6, 6))) * 0.3 + np.eye(6)
        stated = 1e-6 * L @ L.T
        scale = np.diag(np.sqrt([9.0] * 3 + [100.0] * 3))
        entries.append((rng.multivariate_normal(np.zeros(6), scale @ stated @ scale), stated))
    assert inflations(entries) == pytest.approx((9.0, 100.0), rel=0.15)
