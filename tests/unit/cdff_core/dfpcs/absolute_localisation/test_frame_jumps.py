# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Jumps of the frame of poses are distinguished from slip, starts, rotations and odometry resets."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_core.dfpcs.absolute_localisation.frame_jumps import FrameJumpDetector, Step

TICK_NS = 500_000_000
FORWARD = se3.exp_se3([0.5, 0.0, 0.0, 0.0, 0.0, 0.02])


def detector() -> FrameJumpDetector:
    return FrameJumpDetector(0.2, np.radians(2.5))


def drive(
    jumps: FrameJumpDetector, moves: list[np.ndarray], wheels: list[np.ndarray] | None = None
) -> list[Step]:
    """Return the steps for poses with these motions; odometry samples are 30 ms earlier."""
    T, W, steps = np.eye(4), np.eye(4), []
    for k, move in enumerate(moves):
        T = T @ move
        if wheels is not None:
            W = W @ wheels[k]
            jumps.add_odometry(k * TICK_NS - 30_000_000, W)
        steps.append(jumps.step(k * TICK_NS, T))
    return steps


def test_wheel_slip_is_not_a_jump(rng: np.random.Generator) -> None:
    moves = [FORWARD] * 2000
    slip = rng.normal([0.04, 0.0, 0.0, 0.0, 0.0, 0.0], [0.05, 0.02, 0.0, 0.0, 0.0, 0.007], (2000, 6))
    steps = drive(detector(), moves, [m @ se3.exp_se3(s) for m, s in zip(moves, slip, strict=True)])
    assert not any(step.jumped for step in steps)
    assert abs(sum(step.distance_m for step in steps) - 0.5 * 1999) < 1.0


def test_a_jump_is_measured_and_adds_no_distance() -> None:
    jumps, T, W = detector(), np.eye(4), np.eye(4)
    T_new_old = se3.transform(se3.exp_so3(np.array([0.0, 0.0, 0.05])), np.array([0.6, 0.3, 0.0]))
    for k in range(10):
        T, W = T @ FORWARD, W @ FORWARD
        jumps.add_odometry(k * TICK_NS, W)
        step = jumps.step(k * TICK_NS, T if k < 9 else T_new_old @ T)
    assert step.jumped
    assert step.T_new_old is not None
    np.testing.assert_allclose(step.T_new_old, T_new_old, atol=1e-6)
    assert abs(step.distance_m - 0.5) < 0.01


def test_a_reset_of_the_wheel_odometry_is_not_a_jump() -> None:
    jumps, T, W = detector(), np.eye(4), np.eye(4)
    steps = []
    for k in range(40):
        T, W = T @ FORWARD, np.eye(4) if k == 30 else W @ FORWARD
        jumps.add_odometry(k * TICK_NS, W)
        steps.append(jumps.step(k * TICK_NS, T))
    assert not any(step.jumped for step in steps)


def test_without_odometry_only_large_steps_are_jumps() -> None:
    rest, rotation = np.eye(4), se3.exp_se3([0.0, 0.0, 0.0, 0.0, 0.0, 0.3])
    moves = [*[rest] * 5, *[FORWARD] * 5, *[rotation] * 5, *[FORWARD] * 5, *[rest] * 5]
    assert not any(step.jumped for step in drive(detector(), moves))
    T_jump = se3.transform(np.eye(3), [0.0, 3.0, 0.0])
    steps = drive(detector(), [*[FORWARD] * 5, T_jump @ FORWARD, *[FORWARD] * 3])
    assert [step.jumped for step in steps] == [False] * 5 + [True] + [False] * 3
    assert steps[5].T_new_old is None
    assert abs(steps[5].distance_m - 0.5) < 0.01
