# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Adaptation of noise to the innovations, and its place in the checkpoint."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Status
from cdff_core.dfpcs.position_manager.innovation_statistics import adapted_factor
from tests.support.position_manager_samples import feed, imu, manager, pose, times, true_pose


def alternating_wheels(t_s: float) -> Sample:
    """Return wheels without covariance, whose poses are alternately 12 mm too far ahead and too far back."""
    error_m = (0.012 if round(10 * t_s) % 2 else -0.012) if t_s > 1.5 else 0.0
    T = true_pose(t_s) @ se3.transform(np.eye(3), [error_m, 0.0, 0.0])
    return pose("odometry", t_s, T, None, "mana/odom", "mana/base", Status.OK)


def test_the_factor_converges_to_the_ratio_of_true_and_stated_variance() -> None:
    factor = 1.0
    for _ in range(500):
        factor = adapted_factor(factor, 9.0 / factor)
    assert factor == pytest.approx(9.0, rel=0.05)


def test_stated_variances_are_not_reduced() -> None:
    assert adapted_factor(1.0, 0.1) == 1.0


def test_noise_that_is_not_stated_is_learnt_and_survives_a_restart() -> None:
    dfpc = manager()
    feed(dfpc, [alternating_wheels(t) for t in times(10, 15)] + [imu(t, np.eye(3)) for t in times(100, 15)])
    estimate = dfpc._history.newest
    assert estimate.noise_factor("odometry") > 2.0
    state = dfpc.state()
    resumed = manager()
    resumed.resume(state)
    restored = resumed._history.newest
    assert restored.noise_factor("odometry") == pytest.approx(estimate.noise_factor("odometry"))
    assert restored.wheel_speed_m_s == pytest.approx(estimate.wheel_speed_m_s)
    assert restored.clones["odometry"].refusals == estimate.clones["odometry"].refusals
