# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Schedule of the checkpoints of the map."""

from __future__ import annotations

#: Path length after which the state is checkpointed again.
_CHECKPOINT_PATH_M = 1.0


class CheckpointSchedule:
    """Checkpoints every metre and after 1, 2, 4, … sweeps: the first sweeps add most to a map."""

    def __init__(self) -> None:
        self._sweeps = 0
        self._last_path_length_m = 0.0

    def is_due(self, path_length_m: float) -> bool:
        """Count one more sweep and return whether the state is to be checkpointed."""
        self._sweeps += 1
        is_due = path_length_m - self._last_path_length_m > _CHECKPOINT_PATH_M or is_power_of_two(
            self._sweeps
        )
        if is_due:
            self._last_path_length_m = path_length_m
        return is_due


def is_power_of_two(count: int) -> bool:
    """Return whether a positive count is 1, 2, 4, 8, …"""
    return count & (count - 1) == 0
