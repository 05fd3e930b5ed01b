# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from cdff_core.keyframe_graph.checkpoint_schedule import CheckpointSchedule, is_power_of_two


def test_at_rest_a_checkpoint_is_due_after_powers_of_two_sweeps() -> None:
    schedule = CheckpointSchedule()
    assert [n for n in range(1, 17) if schedule.is_due(0.0)] == [1, 2, 4, 8, 16]


def test_in_motion_a_checkpoint_is_due_after_each_metre() -> None:
    schedule = CheckpointSchedule()
    assert [n for n in range(1, 40) if schedule.is_due(0.25 * n) and n > 16] == [21, 26, 31, 32, 37]


def test_powers_of_two_are_recognised() -> None:
    assert [n for n in range(1, 20) if is_power_of_two(n)] == [1, 2, 4, 8, 16]
