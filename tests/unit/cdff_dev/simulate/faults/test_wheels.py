# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faults of wheel odometry change increments by the stated amounts."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_dev.simulate.faults.wheels import SkidSteering, SlipEpisodes, WheelFaults, disturbed
from cdff_dev.simulate.proprioception import wheel_odometry
from cdff_dev.simulate.world import World

STEP_M = np.full(2000, 0.05)
NOTHING = np.zeros(2000)


def test_increments_alternate_and_keep_the_path_length(rng: np.random.Generator) -> None:
    dx, dy, dyaw = disturbed(WheelFaults(alternation=0.17), STEP_M, NOTHING, NOTHING, rng)
    np.testing.assert_allclose(dx[:4] / STEP_M[:4], [1.17, 0.83, 1.17, 0.83])
    assert dx.sum() == pytest.approx(STEP_M.sum())
    assert not dy.any()
    assert not dyaw.any()


def test_a_skidding_rover_measures_another_turn_and_misses_sideways_motion(rng: np.random.Generator) -> None:
    turn = np.full(2000, 0.01)
    faults = WheelFaults(skid=SkidSteering(yaw_ratio=1.3, centre_offset_m=-0.1))
    _, dy, dyaw = disturbed(faults, STEP_M, NOTHING, turn, rng)
    np.testing.assert_allclose(dyaw, 1.3 * turn)
    np.testing.assert_allclose(dy, -0.1 * turn)


def test_wheels_that_spin_measure_more_in_episodes(rng: np.random.Generator) -> None:
    faults = WheelFaults(slip=SlipEpisodes(per_m=0.2, length_m=0.5, slip=0.4))
    dx, _, _ = disturbed(faults, STEP_M, NOTHING, NOTHING, rng)
    ratio = dx / STEP_M
    assert ratio.min() == pytest.approx(1.0)
    assert ratio.max() == pytest.approx(1.0 / 0.6)
    # 0.2 episodes of 0.5 m in each metre; few overlap.
    assert np.mean(ratio > 1.0) == pytest.approx(0.1, abs=0.06)


def test_a_delayed_pose_is_that_of_an_earlier_time(world: World) -> None:
    data = dict.fromkeys(("slip_mean", "slip_per_slope", "slip_sigma", "side_slip_per_slope"), 0.0)
    model = world.scenario.wheels.model_copy(
        update=data | {"yaw_gain_sigma": 0.0, "yaw_noise_rad_sqrt_m": 0.0}
    )
    t_s = np.arange(0.0, 1.0, 0.1)
    rngs = [np.random.default_rng(k) for k in range(3)]
    on_time = wheel_odometry(model, world.motions["mana"], t_s, rngs[0])
    late = wheel_odometry(model, world.motions["mana"], t_s, rngs[1], (WheelFaults(delay_s=0.1), rngs[2]))
    np.testing.assert_allclose(late.poses[1:], on_time.poses[:-1], atol=1e-12)
    assert np.abs(late.poses - on_time.poses).max() > 0.01
