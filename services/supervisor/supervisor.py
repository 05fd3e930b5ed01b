# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Supervision of processes: staggered start, restart after failure or silence, end within a few seconds."""

from __future__ import annotations

import logging
import signal
import subprocess
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cdff_common.clock import monotonic_s
from services.alarms import Alarms, Severity
from services.supervisor.alarm_link import start_alarm_link
from services.supervisor.child import Child, Limits
from services.supervisor.plan import ProcessSpec
from services.supervisor.profile_link import SupervisorLink
from services.supervisor.readiness import Readiness, expected_tokens

logger = logging.getLogger(__name__)

POLL_S = 0.2
#: Longest time between two polls that counts as silence of the processes, seconds: while this process or the
#: machine is stopped, the others are, too.
_LONGEST_POLL_S = 1.0
#: Time between two checks of the size of the logs, seconds.
_ROTATION_S = 10.0
#: Time between two starts, so that imports do not compete for few cores, seconds.
STAGGER_S = 0.4
#: Time for processes to end after SIGTERM, seconds.
GRACE_S = 2.5
#: Time for the router to end after SIGTERM, once all other processes have ended.
ROUTER_GRACE_S = 0.7


@dataclass(slots=True)
class Supervisor:
    """Supervisor of the processes of a plan.

    Parameters
    ----------
    specs : sequence of ProcessSpec
        Processes in start order.
    log_dir : Path or None
        Folder of a log file per process; None: standard error of this process.
    limits : Limits, optional
    link : SupervisorLink, optional
        Router on which it publishes its alarms and profiles.
    on_ready : callable, optional
        Called once when all services are alive; it needs the link.
    """

    specs: Sequence[ProcessSpec]
    log_dir: Path | None = None
    limits: Limits = field(default_factory=Limits)
    link: SupervisorLink | None = None
    on_ready: Callable[[], None] | None = None
    children: dict[str, Child] = field(default_factory=dict)
    alarms: Alarms = field(default_factory=Alarms)

    def run(self, stop: threading.Event) -> None:
        """Start and restart the processes until ``stop``, then end them. Call it from the main thread.

        The kernel sends SIGTERM to the children when the thread that started them ends, so that even a
        SIGKILL of the supervisor leaves no orphan.
        """
        if self.link is not None:
            readiness = self.on_ready and Readiness(expected_tokens(self.specs), self.on_ready)
            start_alarm_link(self.alarms, self.link, stop, readiness)
        polled_s = rotated_s = monotonic_s()
        for i, spec in enumerate(self.specs):
            log = None if self.log_dir is None else self.log_dir / f"{spec.name}.log"
            self.children[spec.name] = Child(spec, self.limits, start_at_s=polled_s + i * STAGGER_S, log=log)
        try:
            while not stop.wait(POLL_S):
                elapsed_s, polled_s = monotonic_s() - polled_s, monotonic_s()
                for child in self.children.values():
                    self._check(child, min(elapsed_s, _LONGEST_POLL_S))
                if polled_s - rotated_s > _ROTATION_S:
                    rotated_s = polled_s
                    self._rotate_logs()
        finally:
            self.end()

    def end(self) -> None:
        """End all processes, newest first, by SIGTERM and then SIGKILL.

        The router ends last, since a session without a router closes slowly.
        """
        running = [c for c in self.children.values() if c.process is not None and c.process.poll() is None]
        self._end_group(running[:0:-1], GRACE_S)
        self._end_group(running[:1], ROUTER_GRACE_S)

    def _end_group(self, group: Sequence[Child], grace_s: float) -> None:
        for child in group:
            assert child.process is not None
            child.process.send_signal(signal.SIGTERM)
        deadline_s = monotonic_s() + grace_s
        for child in group:
            assert child.process is not None
            try:
                child.process.wait(max(deadline_s - monotonic_s(), 0.02))
            except subprocess.TimeoutExpired:
                logger.warning(
                    "%s did not end within %g s of SIGTERM and is killed", child.spec.name, grace_s
                )
                child.process.kill()
                child.process.wait()

    def _rotate_logs(self) -> None:
        for child in self.children.values():
            try:
                child.rotate_log()
            except OSError as error:  # a full disk must not end the supervision
                logger.warning("the log of %s is not rotated: %s", child.spec.name, error)

    def _check(self, child: Child, elapsed_s: float) -> None:
        now_s, name = monotonic_s(), child.spec.name
        if child.process is None:
            if now_s >= child.start_at_s:
                logger.info("started %s (pid %d)", name, child.start())
            return
        code = child.process.poll()
        if code is None:
            silence = child.listen(elapsed_s)
            if silence:
                self.alarms.set(
                    "hung_process",
                    name,
                    Severity.WARNING,
                    f"{silence}; it is killed and started again",
                    "read its log",
                )
                child.process.kill()  # SIGTERM has no effect on a stopped process
            elif child.has_recovered(now_s):
                self.alarms.clear("hung_process", name)
                self.alarms.clear("crash_loop", name)
            return
        wait_s = child.add_failure(now_s)
        logger.warning("%s ended with code %s; starting it again in %.1f s", name, code, wait_s)
        if child.in_crash_loop:
            self.alarms.set(
                "crash_loop",
                name,
                Severity.CRITICAL,
                f"{name} ended {len(child.failures_s)} times within {self.limits.crash_loop_window_s:g} s, "
                f"last with code {code}; it is started every {wait_s:g} s, and the others run without it",
                "read its log and correct the cause",
            )
