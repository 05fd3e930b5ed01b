# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wheels whose poses alternate, and increments that are refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Status
from cdff_core.dfpcs.position_manager.imu_buffer import ImuBuffer
from evaluation import position_manager_husky as evaluation
from evaluation.data_sets import husky
from tests.support.position_manager_samples import (
    T0,
    feed,
    imu,
    manager,
    pose,
    poses,
    times,
    true_pose,
    wheels,
)

STATED = np.diag([1e-3] * 5 + [0.03])


def alternating_wheels(t_s: float, error_m: float) -> Sample:
    """Return a sample of wheels whose poses are alternately too far ahead and too far back."""
    sign = 1.0 if round(10 * t_s) % 2 else -1.0
    T = true_pose(t_s) @ se3.transform(np.eye(3), [sign * error_m if t_s > 1.5 else 0.0, 0.0, 0.0])
    return pose("odometry", t_s, T, STATED, "mana/odom", "mana/base", Status.OK)


def test_increments_that_alternate_are_used_and_do_not_change_the_path_length() -> None:
    samples = [alternating_wheels(t, 0.005) for t in times(10, 10)] + [
        imu(t, np.eye(3)) for t in times(100, 10)
    ]
    dfpc = manager()
    out = poses(feed(dfpc, samples))
    assert not any("odometry_refused" in o.quality.reasons for o in out)
    T = dfpc.get_pose("mana/odom", "mana/base", -1).transform.matrix
    assert np.linalg.norm(T[:3, 3] - true_pose(10.0)[:3, 3]) < 0.03


def test_wheels_without_imu_follow_a_curve_as_their_own_pose_does() -> None:
    dfpc = manager()
    feed(dfpc, [replace(wheels(t), value=alternating_wheels(t, 0.0).value) for t in times(10, 20)])
    estimated = dfpc.get_pose("mana/odom", "mana/base", -1).transform
    assert np.linalg.norm(estimated.matrix[:3, 3] - true_pose(20.0)[:3, 3]) < 0.15


def test_the_path_through_a_refused_increment_is_not_lost() -> None:
    """One wheel pose is 0.4 m off; the increment from the last good pose to the next one is used."""
    samples = [imu(t, np.eye(3)) for t in times(100, 8)]
    for t in times(10, 8):
        sample = wheels(t)
        if t == 5.0:
            far = true_pose(t) @ se3.transform(np.eye(3), [0.3, 0.3, 0.0])
            sample = pose("odometry", t, far, None, "mana/odom", "mana/base", Status.OK)
        samples.append(sample)
    dfpc = manager()
    out = poses(feed(dfpc, samples))
    assert any("odometry_refused" in o.quality.reasons for o in out)
    T = dfpc.get_pose("mana/odom", "mana/base", -1).transform.matrix
    assert np.linalg.norm(T[:3, 3] - true_pose(8.0)[:3, 3]) < 0.03


def test_the_noise_of_the_imu_is_measured_by_differences_of_its_readings(rng: np.random.Generator) -> None:
    buffer = ImuBuffer(10_000_000_000)
    buffer.T_base_imu = np.eye(4)
    assert buffer.noise(T0) == (None, None)
    for k in range(200):
        slow = np.array([np.sin(0.01 * k), 0.0, 9.8])
        buffer.insert(T0 + k * 10_000_000, slow + 0.5 * rng.standard_normal(3), 0.01 * rng.standard_normal(3))
    force, rate = buffer.noise(T0 + 2_000_000_000)
    assert force == pytest.approx(0.5 * np.sqrt(0.01), rel=0.25)
    assert rate == pytest.approx(0.01 * np.sqrt(0.01), rel=0.25)


@pytest.mark.slow
def test_a_real_skid_steered_rover_is_followed_better_than_by_wheel_speed_and_gyro(
    real_data: Callable[[str], Path],
) -> None:
    path: Path = real_data(husky.FILE)
    report = evaluation.evaluate_drive(husky.read_drive(path), evaluation.SETS)
    error_m = report["error_m"]
    assert error_m["wheels, imu"] <= error_m["wheel speed, gyro's yaw"]
    assert error_m["wheels alone"] <= 1.1 * error_m["wheels' own pose"]
