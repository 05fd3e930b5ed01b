# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A supervised process: its start with a pipe for heartbeats, the last heartbeat, and its failures."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

from cdff_common.clock import monotonic_s
from cdff_common.heartbeat import VARIABLE
from services.supervisor.plan import ProcessSpec
from services.supervisor.starvation import Starvation

#: Fraction of the silence limit after which the time that the process waits for a processor is measured.
_SUSPECT = 0.1


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the supervision.

    Attributes
    ----------
    silence_s : float
        Time without a heartbeat after which a process counts as hung; the time in which the process waited
        for a processor does not count.
    first_beat_s : float
        The same before the first heartbeat, since imports may compile kernels.
    backoff_first_s, backoff_longest_s : float
        First and longest wait before a restart; it doubles with each failure.
    stable_s : float
        Running time after which the wait starts again at the first one.
    crash_loop_failures, crash_loop_window_s
        A process that failed so often within this time is in a crash loop.
    crash_loop_wait_s : float
        Wait before each restart in a crash loop.
    recovered_s : float
        Running time after which a crash loop is over.
    log_bytes, logs_kept
        Size at which the log of a process is rotated, and number of rotated logs.
    """

    silence_s: float = 15.0
    first_beat_s: float = 120.0
    backoff_first_s: float = 0.2
    backoff_longest_s: float = 3.0
    stable_s: float = 10.0
    crash_loop_failures: int = 5
    crash_loop_window_s: float = 300.0
    crash_loop_wait_s: float = 60.0
    recovered_s: float = 120.0
    log_bytes: int = 16_000_000
    logs_kept: int = 3


@dataclass(slots=True)
class Child:
    """A process and its restarts.

    Attributes
    ----------
    start_at_s, started_s : float
        Time of the next start and of the last one, monotonic seconds.
    silent_s : float
        Time since the last heartbeat, or since the start.
    has_beaten : bool
        True after the first heartbeat.
    failures_s : deque of float
        Times of the last failures.
    in_crash_loop : bool
    """

    spec: ProcessSpec
    limits: Limits
    process: subprocess.Popen[bytes] | None = None
    started_s: float = 0.0
    start_at_s: float = 0.0
    restarts: int = 0
    log: Path | None = None
    silent_s: float = 0.0
    has_beaten: bool = False
    in_crash_loop: bool = False
    failures_s: deque[float] = field(default_factory=deque)
    _backoff_s: float = 0.0
    _starvation: Starvation | None = None
    _pipe: int | None = None

    def start(self) -> int:
        """Start the process and return its id."""
        read, write = os.pipe()
        os.set_blocking(read, False)
        environment = {
            **os.environ,
            **self.spec.environment,
            "CDFF_SUPERVISOR": str(os.getpid()),
            VARIABLE: str(write),
        }
        output = None if self.log is None else self.log.open("ab")
        try:
            self.process = subprocess.Popen(
                self.spec.argv,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
                pass_fds=(write,),
            )
        finally:
            os.close(write)
            if output is not None:
                output.close()
        self._pipe, self.silent_s, self.has_beaten, self._starvation = read, 0.0, False, None
        self.started_s = monotonic_s()
        return self.process.pid

    def listen(self, elapsed_s: float) -> str:
        """Read the heartbeats of the last ``elapsed_s``; return why the process is hung, if it is."""
        self.silent_s += elapsed_s
        if self._pipe is not None:
            try:
                if os.read(self._pipe, 65536):
                    self.silent_s, self.has_beaten, self._starvation = 0.0, True, None
            except BlockingIOError:
                pass
        limit_s = self.limits.silence_s if self.has_beaten else self.limits.first_beat_s
        if self._starvation is None and self.silent_s > _SUSPECT * limit_s and self.process is not None:
            self._starvation = Starvation(self.process.pid)
        if self.silent_s <= limit_s:
            return ""
        waited_s = 0.0 if self._starvation is None else self._starvation.waited_s()
        if self.silent_s - waited_s <= limit_s:
            return ""
        return f"{self.spec.name} sent no heartbeat for {self.silent_s:.0f} s"

    def rotate_log(self) -> None:
        """Copy a large log to ``….1`` (older ones move to ``….2`` and so on) and empty it.

        The process keeps its descriptor of the log, so the log cannot be renamed. Lines that the process
        writes between copying and emptying are lost.
        """
        if self.log is None or not self.log.is_file() or self.log.stat().st_size < self.limits.log_bytes:
            return
        for number in range(self.limits.logs_kept - 1, 0, -1):
            older = self.log.with_name(f"{self.log.name}.{number}")
            if older.is_file():
                older.replace(self.log.with_name(f"{self.log.name}.{number + 1}"))
        shutil.copyfile(self.log, self.log.with_name(f"{self.log.name}.1"))
        os.truncate(self.log, 0)

    def add_failure(self, now_s: float) -> float:
        """Record the end of the process; return the wait before its restart, seconds."""
        if self._pipe is not None:
            os.close(self._pipe)
        limits = self.limits
        self.process = self._pipe = None
        self.restarts += 1
        self.failures_s.append(now_s)
        while now_s - self.failures_s[0] > limits.crash_loop_window_s:
            self.failures_s.popleft()
        if len(self.failures_s) >= limits.crash_loop_failures:
            self.in_crash_loop = True
        if self.in_crash_loop:
            wait_s = limits.crash_loop_wait_s
        else:
            is_first = self._backoff_s == 0.0 or now_s - self.started_s > limits.stable_s
            wait_s = (
                limits.backoff_first_s if is_first else min(2.0 * self._backoff_s, limits.backoff_longest_s)
            )
            self._backoff_s = wait_s
        self.start_at_s = now_s + wait_s
        return wait_s

    def has_recovered(self, now_s: float) -> bool:
        """Return True, once, if the process has run for ``recovered_s`` after a failure."""
        if not self.failures_s or now_s - self.started_s < self.limits.recovered_s:
            return False
        self.failures_s.clear()
        self.in_crash_loop, self._backoff_s = False, 0.0
        return True
