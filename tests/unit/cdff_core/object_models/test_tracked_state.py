# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""TrackedState: correction by a pose that already contains the prediction."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_core.object_models.tracked_state import STATE_ERROR_DIM, TrackedState


def test_a_pose_with_the_prediction_is_used_like_its_measurement(rng: np.random.Generator) -> None:
    root = rng.normal(size=(STATE_ERROR_DIM, STATE_ERROR_DIM)) * 0.01
    prior = root @ root.T
    state = TrackedState(
        stamp_ns=0,
        T=se3.transform(se3.exp_so3([0.3, -0.2, 0.5]), [0.1, 0.2, 5.0]),
        velocity=np.zeros(3),
        rate=np.zeros(3),
        centre_of_mass_m=np.zeros(3),
        inertia=np.eye(3),
        covariance=prior,
    )
    noise = np.diag(np.square([0.02, 0.03, 0.05, 0.01, 0.02, 0.01]))
    measured = rng.normal(size=6) * 0.01
    gain = prior[:, :6] @ np.linalg.inv(prior[:6, :6] + noise)
    correction, posterior = gain @ measured, prior - gain @ prior[:6]
    expected = state.corrected(correction, posterior)
    updated = state.with_pose(expected.T, posterior[:6, :6])
    np.testing.assert_allclose(pose_error(updated.T, expected.T), np.zeros(6), atol=1e-9)
    np.testing.assert_allclose(updated.velocity, expected.velocity, atol=1e-9)
    np.testing.assert_allclose(updated.rate, expected.rate, atol=1e-9)
    np.testing.assert_allclose(updated.covariance, posterior, atol=1e-10)
