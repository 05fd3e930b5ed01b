# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_core.dfns.scan_to_map_registration._priors import Prior, fuse_with_guess
from cdff_core.dfns.scan_to_map_registration.interface import ScanToMapRegistrationInputs as Inputs

X = np.eye(6)[:1]
T = se3.transform(np.eye(3), np.array([1.0, 1.0, 0.0]))
COVARIANCE = 1e-4 * np.eye(6)


def prior() -> Prior:
    inputs = Inputs(guess_covariance=np.diag([0.04, 0.04, 0.04, 1e-3, 1e-3, 1e-3]))
    return Prior.from_inputs(inputs, np.eye(4), np.zeros(6))


def test_guess_and_registration_are_weighted_by_their_variances() -> None:
    fusion = fuse_with_guess(prior(), T, COVARIANCE, X, np.array([0.1]), radius_m=10.0)
    np.testing.assert_allclose(fusion.gains, [0.8])
    np.testing.assert_allclose(fusion.T[:3, 3], [0.8, 1.0, 0.0])
    np.testing.assert_allclose(fusion.covariance[0, 0], 0.04 * 0.01 / 0.05)
    np.testing.assert_allclose(fusion.covariance[1:, 1:], COVARIANCE[1:, 1:], atol=1e-15)


def test_the_guess_remains_along_a_direction_that_the_map_does_not_constrain() -> None:
    fusion = fuse_with_guess(prior(), T, COVARIANCE, X, np.array([1e3]), radius_m=10.0)
    np.testing.assert_allclose(fusion.T[:3, 3], [0.0, 1.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(fusion.covariance[0, 0], 0.04, rtol=1e-6)
