# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measurements of the last seconds in the order of time, with the estimate after each."""

from __future__ import annotations

from bisect import bisect_left, bisect_right

from cdff_core.dfpcs.position_manager.estimate import Estimate
from cdff_core.dfpcs.position_manager.estimator import Estimator, Event, Verdict
from cdff_core.dfpcs.position_manager.time_line import TimeLine


class History:
    """Takes measurements in any order: a late one leads to all after it being taken again.

    Parameters
    ----------
    start : Estimate
    line : TimeLine
        Gets the estimates; its end is drawn anew with each late measurement.
    memory_ns : int
        How late a measurement may come.
    """

    def __init__(self, estimator: Estimator, start: Estimate, line: TimeLine, memory_ns: int) -> None:
        self._estimator, self._line, self._memory_ns = estimator, line, memory_ns
        self._base = start
        self._events: list[Event] = []
        self._stamps: list[int] = []
        self._estimates: list[Estimate] = []
        self._dirty_ns: int | None = None
        line.append(start)

    @property
    def newest(self) -> Estimate:
        """The estimate of the newest time."""
        self.refresh()
        return self._estimates[-1] if self._estimates else self._base

    @property
    def oldest_ns(self) -> int:
        """The time from which measurements may be taken again."""
        return self._base.stamp_ns

    def reaches(self, stamp_ns: int) -> bool:
        """Whether a measurement of a time is not too late."""
        return stamp_ns >= self._base.stamp_ns

    def doubt(self, stamp_ns: int) -> None:
        """Take the measurements after a time again when the estimate is next needed: an IMU reading came late."""
        if self._estimates and stamp_ns < self._estimates[-1].stamp_ns:
            self._dirty_ns = stamp_ns if self._dirty_ns is None else min(self._dirty_ns, stamp_ns)

    def refresh(self) -> None:
        """Do what ``doubt`` left to do."""
        if self._dirty_ns is not None:
            first = bisect_left(self._stamps, self._dirty_ns)
            self._dirty_ns = None
            self._again(first)

    def insert(self, event: Event) -> Verdict:
        """Take a measurement that ``reaches``, and all that came before it but are of later times again."""
        self.refresh()
        k = bisect_right(self._stamps, event.stamp_ns)
        while k and self._stamps[k - 1] == event.stamp_ns and self._events[k - 1].source > event.source:
            k -= 1  # those of one time by their names, so that it does not matter which came first
        self._stamps.insert(k, event.stamp_ns)
        self._events.insert(k, event)
        verdict = self._again(k)
        self._forget(self._stamps[-1] - self._memory_ns)
        return verdict

    def _again(self, first: int) -> Verdict:
        """Take the measurements from index ``first`` on; what became of that one."""
        estimate = self._estimates[first - 1] if first else self._base
        del self._estimates[first:]
        self._line.cut(estimate.stamp_ns)
        verdict = Verdict(False)
        for event in self._events[first:]:
            estimate, said = self._estimator.after(estimate, event)
            if len(self._estimates) == first:
                verdict = said
            self._estimates.append(estimate)
            self._line.append(estimate)
        return verdict

    def _forget(self, stamp_ns: int) -> None:
        cut = bisect_left(self._stamps, stamp_ns)
        # In blocks: a list is shortened from the front at the price of moving the rest.
        if cut > 64:
            self._base = self._estimates[cut - 1]
            del self._stamps[:cut], self._events[:cut], self._estimates[:cut]
