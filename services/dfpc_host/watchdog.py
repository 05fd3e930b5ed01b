# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Detection of steps that stall: a step that computes slowly is not one.

The kernel accounts for each thread the time on a CPU and the time in which it waits for one. A step on a
slow or loaded machine spends its whole duration in these two; one that waits for a lock, a file or another
process spends it in neither. The time in which the whole process is stopped, with its machine or by a signal,
does not count.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

#: Least fraction of the time in which a step must be on a CPU or wait for one, to count as working.
_WORKING_FRACTION = 0.01
#: Longest time between two checks, seconds; in the rest of a longer one the whole process was stopped.
_LONGEST_INTERVAL_S = 1.0
#: Longest CPU time of a step, in step timeouts: an endless loop.
ENDLESS_TIMEOUTS = 30.0


@dataclass(frozen=True, slots=True)
class ThreadTimes:
    """CPU time of a thread, and its time on a CPU or waiting for one, seconds."""

    cpu_s: float
    runnable_s: float

    @classmethod
    def of(cls, thread: Thread) -> ThreadTimes | None:
        """Return the times of a running thread; None if it has ended."""
        folder = Path(f"/proc/self/task/{thread.native_id}")
        try:
            cpu_ns, waiting_ns = map(int, (folder / "schedstat").read_text(encoding="ascii").split()[:2])
            return cls(1e-9 * cpu_ns, 1e-9 * (cpu_ns + waiting_ns))
        except (OSError, ValueError):  # the thread has ended, or the kernel has no such statistics
            pass
        try:
            fields = (
                (folder / "stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
            )
        except OSError:
            return None
        cpu_s = sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")  # utime and stime
        return cls(cpu_s, cpu_s)


class StepWatchdog:
    """Detection of a stalled or endless step of one DFPC.

    Parameters
    ----------
    timeout_s : float
        Time without work after which a step counts as stalled.
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._step_started_s: float | None = None
        self._worked_at_s = 0.0
        self._checked_at_s: float | None = None
        self._at_last_work = self._at_start = ThreadTimes(0.0, 0.0)

    def problem(self, step_started_s: float | None, now_s: float, times: ThreadTimes | None) -> str:
        """Return why the running step shall be ended; empty if it works, or if no step runs.

        Parameters
        ----------
        step_started_s : float or None
            Start of the running step, monotonic seconds.
        times : ThreadTimes or None
            Times of the thread of the step.
        """
        interval_s = 0.0 if self._checked_at_s is None else now_s - self._checked_at_s
        stopped_s = max(interval_s - _LONGEST_INTERVAL_S, 0.0)
        self._checked_at_s = now_s
        if step_started_s is None or times is None:
            self._step_started_s = None
            return ""
        if step_started_s != self._step_started_s:
            self._step_started_s, self._worked_at_s = step_started_s, now_s
            self._at_last_work = self._at_start = times
        else:
            self._worked_at_s += stopped_s
        worked_s = times.runnable_s - self._at_last_work.runnable_s
        if worked_s >= _WORKING_FRACTION * self._timeout_s:
            self._worked_at_s, self._at_last_work = now_s, times
        stalled_s, cpu_s = now_s - self._worked_at_s, times.cpu_s - self._at_start.cpu_s
        if stalled_s > self._timeout_s:
            return f"stalls: it waits for {stalled_s:.1f} s without computing"
        if cpu_s > ENDLESS_TIMEOUTS * self._timeout_s:
            return f"does not end: it has computed for {cpu_s:.0f} s"
        return ""
