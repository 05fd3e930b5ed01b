# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Supervision of processes: staggered start, restart after failure, and end within a few seconds."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cdff_common.clock import monotonic_s
from services.supervisor.plan import ProcessSpec

logger = logging.getLogger(__name__)

POLL_S = 0.05
#: Time between two starts, so that imports do not compete for few cores, seconds.
STAGGER_S = 0.4
#: Back-off of a failing process: first and longest wait, seconds; reset after ``STABLE_S`` of running.
BACKOFF_FIRST_S = 0.2
BACKOFF_LONGEST_S = 3.0
STABLE_S = 10.0
#: Time for processes to end after SIGTERM, seconds.
GRACE_S = 2.5
ROUTER_GRACE_S = 0.7


@dataclass(slots=True)
class Child:
    """A process and its restarts."""

    spec: ProcessSpec
    process: subprocess.Popen[bytes] | None = None
    started_s: float = 0.0
    start_at_s: float = 0.0
    backoff_s: float = BACKOFF_FIRST_S
    restarts: int = 0
    log: Path | None = None


@dataclass(slots=True)
class Supervisor:
    """Supervisor of the processes of a plan.

    Parameters
    ----------
    specs : sequence of ProcessSpec
        Processes in start order.
    log_dir : Path or None
        Folder of a log file per process; None: standard error of this process.
    """

    specs: Sequence[ProcessSpec]
    log_dir: Path | None = None
    children: dict[str, Child] = field(default_factory=dict)

    def run(self, stop: threading.Event) -> None:
        """Start and restart the processes until ``stop``, then end them. Call it from the main thread.

        The kernel sends SIGTERM to the children when the thread that started them ends, so that even a
        SIGKILL of the supervisor leaves no orphan.
        """
        start_s = monotonic_s()
        for i, spec in enumerate(self.specs):
            log = None if self.log_dir is None else self.log_dir / f"{spec.name}.log"
            self.children[spec.name] = Child(spec, start_at_s=start_s + i * STAGGER_S, log=log)
        try:
            while not stop.wait(POLL_S):
                for child in self.children.values():
                    self._check(child)
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

    def _check(self, child: Child) -> None:
        now_s = monotonic_s()
        if child.process is None:
            if now_s >= child.start_at_s:
                self._start(child)
            return
        code = child.process.poll()
        if code is None:
            return
        if now_s - child.started_s > STABLE_S:
            child.backoff_s = BACKOFF_FIRST_S
        logger.warning(
            "%s ended with code %s; starting it again in %.1f s", child.spec.name, code, child.backoff_s
        )
        child.process = None
        child.restarts += 1
        child.start_at_s = now_s + child.backoff_s
        child.backoff_s = min(child.backoff_s * 2, BACKOFF_LONGEST_S)

    def _start(self, child: Child) -> None:
        environment = {**os.environ, **child.spec.environment, "CDFF_SUPERVISOR": str(os.getpid())}
        output = None if child.log is None else child.log.open("ab")
        try:
            child.process = subprocess.Popen(
                child.spec.argv,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )
        finally:
            if output is not None:
                output.close()
        child.started_s = monotonic_s()
        logger.info("started %s (pid %d)", child.spec.name, child.process.pid)
