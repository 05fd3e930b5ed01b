# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Time in which a process waited for a processor: on a busy machine it is slow, not hung.

A hung process sleeps or computes. One that other programs displace has a thread that is ready to run; the
kernel counts how long (``/proc/PID/task/TID/schedstat``, the second number). On systems without these counts
the time is zero.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from cdff_common.clock import monotonic_s

#: Interval between two readings of the counts, seconds: a process has many threads.
_READ_S = 0.5


class Starvation:
    """Waiting time of a process from now on."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._start_s = waits_s(pid)
        self._read_s, self._waited_s = monotonic_s(), 0.0

    def waited_s(self) -> float:
        """Return the time that the thread with the longest wait has waited, seconds."""
        if monotonic_s() - self._read_s >= _READ_S:
            self._read_s = monotonic_s()
            waits = waits_s(self._pid)
            growth = (wait_s - self._start_s.get(thread, 0.0) for thread, wait_s in waits.items())
            self._waited_s = max(self._waited_s, max(growth, default=0.0))
        return self._waited_s


def waits_s(pid: int) -> dict[str, float]:
    """Return how long each thread of a process has waited for a processor since its start, seconds."""
    waits = {}
    with suppress(OSError):  # the process has ended, or the system has no such files
        for task in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError, IndexError, ValueError):  # the thread has ended
                waits[task.name] = int((task / "schedstat").read_text().split()[1]) / 1e9
    return waits
