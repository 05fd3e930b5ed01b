# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Jumps of the frame of poses, told from slip, starts, turns and odometry that counts anew."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_core.dfpcs.absolute_localisation._jumps import Jumps, Step

TICK_NS = 500_000_000
AHEAD = se3.exp_se3([0.5, 0.0, 0.0, 0.0, 0.0, 0.02])


def jumps() -> Jumps:
    return Jumps(0.2, np.radians(2.5))


def driven(told: Jumps, moves: list[np.ndarray], wheels: list[np.ndarray] | None = None) -> list[Step]:
    """Steps of poses that move so, with what the wheels count where they are given, a little ahead in time."""
    T, W, steps = np.eye(4), np.eye(4), []
    for k, move in enumerate(moves):
        T = T @ move
        if wheels is not None:
            W = W @ wheels[k]
            told.odometry(k * TICK_NS - 30_000_000, W)
        steps.append(told.step(k * TICK_NS, T))
    return steps


def test_wheels_that_slip_and_skid_make_no_jumps(rng: np.random.Generator) -> None:
    moves = [AHEAD] * 2000
    slip = rng.normal([0.04, 0.0, 0.0, 0.0, 0.0, 0.0], [0.05, 0.02, 0.0, 0.0, 0.0, 0.007], (2000, 6))
    steps = driven(jumps(), moves, [m @ se3.exp_se3(s) for m, s in zip(moves, slip, strict=True)])
    assert not any(step.jumped for step in steps)
    assert abs(sum(step.way_m for step in steps) - 0.5 * 1999) < 1.0


def test_a_jump_is_told_by_as_much_as_it_is_and_is_no_way() -> None:
    told, T, W = jumps(), np.eye(4), np.eye(4)
    frame = se3.transform(se3.exp_so3(np.array([0.0, 0.0, 0.05])), np.array([0.6, 0.3, 0.0]))
    for k in range(10):
        T, W = T @ AHEAD, W @ AHEAD
        told.odometry(k * TICK_NS, W)
        step = told.step(k * TICK_NS, T if k < 9 else frame @ T)
    assert step.jumped
    assert step.frame is not None
    np.testing.assert_allclose(step.frame, frame, atol=1e-6)
    assert abs(step.way_m - 0.5) < 0.01


def test_wheels_that_count_from_a_new_origin_are_no_jump() -> None:
    told, T, W = jumps(), np.eye(4), np.eye(4)
    steps = []
    for k in range(40):
        T, W = T @ AHEAD, np.eye(4) if k == 30 else W @ AHEAD
        told.odometry(k * TICK_NS, W)
        steps.append(told.step(k * TICK_NS, T))
    assert not any(step.jumped for step in steps)


def test_by_poses_alone_starts_stops_and_turns_are_no_jumps_but_metres_at_once_are() -> None:
    rest, turn = np.eye(4), se3.exp_se3([0.0, 0.0, 0.0, 0.0, 0.0, 0.3])
    moves = [*[rest] * 5, *[AHEAD] * 5, *[turn] * 5, *[AHEAD] * 5, *[rest] * 5]
    assert not any(step.jumped for step in driven(jumps(), moves))
    away = se3.transform(np.eye(3), [0.0, 3.0, 0.0])
    steps = driven(jumps(), [*[AHEAD] * 5, away @ AHEAD, *[AHEAD] * 3])
    assert [step.jumped for step in steps] == [False] * 5 + [True] + [False] * 3
    assert steps[5].frame is None
    assert abs(steps[5].way_m - 0.5) < 0.01
