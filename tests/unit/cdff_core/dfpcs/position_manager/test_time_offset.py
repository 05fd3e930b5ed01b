# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Time offset between an odometry and the gyro."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_core.dfpcs.position_manager.frame_tree import RobotFrames
from cdff_core.dfpcs.position_manager.imu_buffer import ImuBuffer
from cdff_core.dfpcs.position_manager.measurement import Measurement
from cdff_core.dfpcs.position_manager.time_offset import StampCorrection
from tests.support.position_manager_samples import T0


def heading_rad(t_s: float) -> float:
    """Return the heading on a path of irregular bends."""
    return 0.3 * np.sin(0.9 * t_s) + 0.5 * np.sin(0.37 * t_s + 1.0)


def applied_s(
    delay_s: float,
    rng: np.random.Generator,
    seconds: int = 60,
    *,
    turns: float = 1.0,
    reset_s: float | None = None,
) -> float:
    """Return the offset in use after a drive with wheels whose stamps are late by ``delay_s``.

    At ``reset_s`` the heading of the wheels jumps.
    """
    imu, graph = ImuBuffer(40_000_000_000), FrameGraph()
    graph.set_static("site", "mana/odom", UncertainTransform.exact(np.eye(4)))
    imu.T_base_imu = np.eye(4)
    correction = StampCorrection(imu, RobotFrames("mana", graph, None))
    for k in range(50 * seconds):
        t_s, stamp_ns = 0.02 * k, T0 + k * 20_000_000
        rate = turns * (heading_rad(t_s + 0.005) - heading_rad(t_s - 0.005)) / 0.01
        imu.insert(stamp_ns, np.zeros(3), np.array([0.0, 0.0, rate + 2e-3]) + 0.01 * rng.standard_normal(3))
        if k % 5 == 0:
            angle = 0.95 * turns * heading_rad(t_s - delay_s) + 1e-3 * rng.standard_normal()
            angle += 2.0 if reset_s is not None and t_s >= reset_s else 0.0
            T = UncertainTransform.exact(se3.transform(se3.exp_so3([0.0, 0.0, angle]), np.zeros(3)))
            correction.corrected(Measurement(stamp_ns, "odometry", T, "mana/odom", "mana/base"))
    return correction.applied_s.get("odometry", 0.0)


@pytest.mark.parametrize("delay_s", [0.1, -0.15])
def test_a_delay_is_found_despite_gyro_bias_and_scale_error(delay_s: float, rng: np.random.Generator) -> None:
    assert applied_s(delay_s, rng) == pytest.approx(-delay_s, abs=0.03)


def test_synchronised_stamps_are_hardly_changed(rng: np.random.Generator) -> None:
    assert abs(applied_s(0.0, rng)) < 0.03


def test_stamps_are_kept_while_the_robot_drives_straight(rng: np.random.Generator) -> None:
    assert applied_s(0.1, rng, turns=0.0) == 0.0


def test_a_reset_of_the_wheels_does_not_hide_the_delay(rng: np.random.Generator) -> None:
    assert applied_s(0.1, rng, reset_s=30.0) == pytest.approx(-0.1, abs=0.03)
