# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Loops of a service that survive every error of one cycle, and their health; health of other work.

A loop waits for work and does it. An exception in a cycle is logged, counted and survived. A loop that ended
without being stopped, or that is busy for longer than its limit, is a problem: the service reports it, and
its process ends, so that a supervisor replaces it (``cdff_common.heartbeat``).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from cdff_common.clock import monotonic_s

logger = logging.getLogger(__name__)

_T = TypeVar("_T")


class Loop:
    """State of one loop.

    Attributes
    ----------
    name : str
    busy_limit_s : float or None
        Longest duration of the work of one cycle, seconds; None: no limit.
    errors : int
        Number of cycles that ended with an exception.
    last_error : str
        The last exception; empty without one.
    """

    def __init__(self, name: str, busy_limit_s: float | None, now_s: Callable[[], float]) -> None:
        self.name, self.busy_limit_s = name, busy_limit_s
        self.errors, self.last_error = 0, ""
        self._now_s = now_s
        self._busy_since_s: float | None = None
        self._is_dead = False

    def run(self, wait: Callable[[], _T | None], work: Callable[[_T], object]) -> None:
        """Call ``work`` with each result of ``wait`` until that is None; errors of ``work`` are survived."""
        has_ended_as_demanded = False
        try:
            while (item := wait()) is not None:
                self._cycle(work, item)
            has_ended_as_demanded = True
        finally:
            self._is_dead = not has_ended_as_demanded

    def _cycle(self, work: Callable[[_T], object], item: _T) -> None:
        """Execute one cycle; an error is counted and logged."""
        self._busy_since_s = self._now_s()
        try:
            work(item)
        except Exception as error:  # outermost handler of a cycle: counted and logged
            self.errors += 1
            self.last_error = f"{type(error).__name__}: {error}"
            logger.exception("loop %s: a cycle failed", self.name)
        finally:
            self._busy_since_s = None

    def problem(self) -> str:
        """Return why the loop does not work; empty if it does."""
        busy_since_s = self._busy_since_s
        if self._is_dead:
            return f"loop {self.name} has ended"
        if busy_since_s is None or self.busy_limit_s is None:
            return ""
        busy_s = self._now_s() - busy_since_s
        if busy_s <= self.busy_limit_s:
            return ""
        return f"loop {self.name} is busy for {busy_s:.0f} s; expected at most {self.busy_limit_s:g} s"

    def describe(self) -> dict[str, Any]:
        """Return ``{healthy, problem, errors, last_error}``."""
        problem = self.problem()
        return {
            "healthy": not problem,
            "problem": problem,
            "errors": self.errors,
            "last_error": self.last_error,
        }


class ParallelWork:
    """Pieces of work in several threads, such as calls, of which none may take longer than a limit."""

    def __init__(self, name: str, busy_limit_s: float, now_s: Callable[[], float]) -> None:
        self.name, self.busy_limit_s = name, busy_limit_s
        self._now_s = now_s
        self._started_s: dict[object, float] = {}

    @contextmanager
    def piece(self) -> Iterator[None]:
        """Enclose one piece of work."""
        piece = object()
        self._started_s[piece] = self._now_s()
        try:
            yield
        finally:
            del self._started_s[piece]

    def problem(self) -> str:
        """Return which piece takes too long; empty if none does."""
        busy_s = self._now_s() - min(tuple(self._started_s.values()), default=math.inf)
        if busy_s <= self.busy_limit_s:
            return ""
        return f"{self.name} is busy for {busy_s:.0f} s; expected at most {self.busy_limit_s:g} s"


class Loops:
    """Loops of one service, and its other work that is checked.

    Parameters
    ----------
    now_s : callable
        Monotonic seconds.
    """

    def __init__(self, now_s: Callable[[], float] = monotonic_s) -> None:
        self._now_s = now_s
        self._loops: list[Loop] = []
        self._checks: list[Callable[[], str]] = []

    def add(self, name: str, busy_limit_s: float | None = None) -> Loop:
        """Return a new loop, which is healthy until it runs."""
        loop = Loop(name, busy_limit_s, self._now_s)
        self._loops.append(loop)
        return loop

    def add_parallel(self, name: str, busy_limit_s: float) -> ParallelWork:
        """Return a check of work in several threads."""
        work = ParallelWork(name, busy_limit_s, self._now_s)
        self.add_check(work.problem)
        return work

    def add_check(self, check: Callable[[], str]) -> None:
        """Add a function that returns a problem, or an empty text."""
        self._checks.append(check)

    def remove(self, loop: Loop) -> None:
        """Remove a loop that was stopped."""
        self._loops.remove(loop)

    def problem(self) -> str:
        """Return all problems; empty if there is none."""
        checks = (*(loop.problem for loop in tuple(self._loops)), *self._checks)
        return "; ".join(problem for check in checks if (problem := check()))

    def describe(self) -> dict[str, dict[str, Any]]:
        """Return the state of each loop by its name."""
        return {loop.name: loop.describe() for loop in tuple(self._loops)}
