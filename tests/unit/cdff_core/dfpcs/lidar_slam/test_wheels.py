# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_core.dfpcs.lidar_slam.wheels import Wheels

S = 1_000_000_000
MOUNT = se3.transform(se3.exp_so3(np.array([0.0, 0.0, 0.3])), np.array([0.5, 0.0, 1.0]))


def driven(t_s: float) -> np.ndarray:
    """Base on a circle at constant speed."""
    return se3.exp_se3(t_s * np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.1]))


def wheels(until_s: float, age_s: float = 0.3) -> Wheels:
    found = Wheels(age_s, MOUNT)
    for k in range(round(until_s * 10) + 1):
        found.take(k * S // 10, UncertainTransform(driven(k / 10)))
    return found


def test_the_step_is_that_of_the_lidar() -> None:
    found = wheels(2.0)
    assert found.since_last_sweep(S) is None  # the first sweep has no step
    step = found.since_last_sweep(3 * S // 2)
    assert step is not None
    expected = se3.inverse(driven(1.0) @ MOUNT) @ driven(1.5) @ MOUNT
    np.testing.assert_allclose(step, expected, atol=1e-4)  # interpolated along chords


def test_a_sweep_that_ends_after_the_newest_pose_goes_on_as_before_and_steps_add_up_to_the_way() -> None:
    """The pose at the end of a sweep comes after it: a step that stood still meanwhile would be short each time."""
    found, T = Wheels(0.3, np.eye(4)), np.eye(4)
    for sweep in range(1, 21):
        for k in range(5 * (sweep - 1), 5 * sweep):
            found.take(k * S // 10, UncertainTransform(driven(k / 10)))
        step = found.since_last_sweep(sweep * S // 2)
        if step is not None:
            T = T @ step
    np.testing.assert_allclose(T, se3.inverse(driven(0.5)) @ driven(10.0), atol=1e-9)


def test_an_odometry_that_fell_silent_gives_no_step() -> None:
    found = wheels(2.0, age_s=0.3)
    found.since_last_sweep(S)
    assert found.since_last_sweep(5 * S // 2) is None
    assert found.since_last_sweep(3 * S) is None  # nor is there one from a place that was not known


def test_before_the_first_pose_nothing_is_known() -> None:
    found = Wheels(0.3, np.eye(4))
    assert found.since_last_sweep(S) is None
    found.take(3 * S, UncertainTransform(np.eye(4)))
    assert found.since_last_sweep(2 * S) is None


def test_the_speed_before_the_first_step_is_that_of_the_lidar_and_unknown_without_poses() -> None:
    speed = wheels(2.0).velocity(2 * S)
    assert speed is not None
    expected = se3.inverse(MOUNT) @ se3.exp_se3(np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.02])) @ MOUNT
    np.testing.assert_allclose(speed[:3], expected[:3, 3] / 0.2, atol=1e-6)
    np.testing.assert_allclose(speed[3:], [0.0, 0.0, 0.1], atol=1e-6)
    assert wheels(0.0).velocity(0) is None
