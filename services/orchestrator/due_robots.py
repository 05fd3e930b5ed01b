# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Robots whose due actions must be determined again."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field


@dataclass(slots=True)
class DueRobots:
    """Robots that have changed, and robots with a time that has come; not thread-safe.

    All robots are due at least every ``COMPLETE_S``.
    """

    COMPLETE_S = 5.0
    _changed: set[str] = field(default_factory=set)
    _taken_s: float = -math.inf
    _complete_s: float = -math.inf

    @property
    def complete_at_s(self) -> float:
        """Time from which on all robots are due, monotonic seconds."""
        return self._complete_s + self.COMPLETE_S

    def add(self, robots: Iterable[str]) -> None:
        """Add robots that have changed."""
        self._changed.update(robots)

    def take(self, robots: Iterable[str], times_s: Iterable[tuple[str, float]], now_s: float) -> set[str]:
        """Return the robots that have become due since the last call.

        ``times_s`` are pairs of a robot and the time at which it becomes due, monotonic seconds.
        """
        if now_s >= self.complete_at_s:
            self._complete_s = now_s
            due = set(robots)
        else:
            due = self._changed | {robot for robot, t in times_s if self._taken_s < t <= now_s}
        self._changed, self._taken_s = set(), now_s
        return due
