# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_core.dfpcs.lidar_slam.motion_uncertainty import MotionUncertainty, growth


def test_the_uncertainty_is_large_until_the_velocity_is_known_and_follows_the_errors() -> None:
    uncertainty = MotionUncertainty()
    unknown = np.diag(uncertainty.covariance(0.5))
    uncertainty.update(np.array([1.1, 0, 0, 0, 0, 0]), 0.5)  # a velocity, no error of a prediction
    known = np.diag(uncertainty.covariance(0.5))
    assert np.all(known < unknown)
    uncertainty.update(np.array([0, 0, 0, 0, 0, 0.9]), 0.5)  # a fast turn
    after_turn = np.diag(uncertainty.covariance(0.5))
    assert after_turn[5] > 0.4**2
    np.testing.assert_array_equal(after_turn[:5], known[:5])
    for _ in range(30):
        uncertainty.update(np.zeros(6), 0.5)
    np.testing.assert_allclose(np.diag(uncertainty.covariance(0.5)), known)


def test_the_uncertainty_covers_predictions_over_longer_intervals_than_those_measured(
    rng: np.random.Generator,
) -> None:
    acceleration = rng.normal(0.0, 4.0, (400, 6, 20))  # per step of 0.1 s
    velocity = np.cumsum(0.1 * acceleration, axis=2)
    uncertainty = MotionUncertainty()
    uncertainty.update(np.zeros(6), 0.1)
    for error in 0.1 * velocity[:, :, 0]:
        uncertainty.update(error, 0.1)
    after_2_s = 0.1 * velocity.sum(axis=2)
    ratio = np.mean(after_2_s**2) / np.mean(np.diag(uncertainty.covariance(2.0)))
    assert 0.1 < ratio < 3.0


def test_the_last_increments_add_up_to_the_growth_of_the_pose() -> None:
    for by_odometry in (False, True):
        increments = [growth(k, by_odometry=by_odometry)[1] for k in range(12)]
        poses = [growth(k, by_odometry=by_odometry)[0] for k in range(12)]
        np.testing.assert_allclose(np.cumsum(increments), poses)


def test_a_velocity_that_changes_at_random_has_the_variance_of_the_growth(rng: np.random.Generator) -> None:
    changes = rng.normal(size=(20_000, 8))  # of the motion from sweep to sweep
    distance = np.cumsum(np.cumsum(changes, axis=1), axis=1)[:, -1]
    np.testing.assert_allclose(np.var(distance), growth(7, by_odometry=False)[0], rtol=0.05)
