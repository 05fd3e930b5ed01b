# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Killed, stopped and hung processes."""

from __future__ import annotations

import signal
import time
from contextlib import suppress

import psutil

from cdff_common.clock import monotonic_s
from services.supervisor.child import Limits
from tests.chaos.disturbances.disturbance import Scene
from tests.chaos.mission import wait_until

#: Failures of a service within the window of the supervisor, fewer than a crash loop.
_FAILURES = Limits().crash_loop_failures - 2
_RESTARTED_S = 60.0
#: Service with a crash loop: the others must work without it.
_CRASHING = "icu"


class FailureBudget:
    """Service for the next failure: random, but no service so often that it counts as a crash loop."""

    def __init__(self) -> None:
        self._failures_s: dict[str, list[float]] = {}

    def next_service(self, scene: Scene) -> str | None:
        """Return a service that may fail now, and count its failure; None if there is none."""
        since_s = monotonic_s() - Limits().crash_loop_window_s
        services = list(scene.mission.services)
        scene.rng.shuffle(services)
        for service in services:
            failures_s = [at_s for at_s in self._failures_s.get(service, ()) if at_s > since_s]
            if len(failures_s) < _FAILURES:
                self._failures_s[service] = [*failures_s, monotonic_s()]
                return service
        return None

    def kill(self, scene: Scene) -> None:
        """Send SIGKILL to a service, and wait for its replacement."""
        service = self.next_service(scene)
        if service is not None:
            process = _signal(scene, service, signal.SIGKILL)
            _await_replacement(scene, service, process)

    def crash_repeatedly(self, scene: Scene) -> None:
        """Kill the ICU until the supervisor reports a crash loop; the others run without it."""
        mission, oracle = scene.mission, scene.oracle

        def has_alarm() -> bool:
            process = mission.process(_CRASHING)
            if process is not None:
                with suppress(psutil.NoSuchProcess):
                    process.send_signal(signal.SIGKILL)
            return mission.has_alarm("crash_loop", _CRASHING)

        self._failures_s[_CRASHING] = [monotonic_s()] * Limits().crash_loop_failures
        oracle.expect_alarm("crash_loop", _CRASHING, has_alarm, _RESTARTED_S)

    def hang(self, scene: Scene) -> None:
        """Send SIGSTOP to a service and leave it to the supervisor, which must report and replace it."""
        service = self.next_service(scene)
        if service is None:
            return
        process = _signal(scene, service, signal.SIGSTOP)
        if process is None:
            return
        mission = scene.mission
        scene.oracle.expect_alarm(
            "hung_process", service, lambda: mission.has_alarm("hung_process", service), _RESTARTED_S
        )
        _await_replacement(scene, service, process)


def stop_briefly(scene: Scene) -> None:
    """Send SIGSTOP to a service and SIGCONT before it counts as hung; for the router a partition."""
    service = scene.rng.choice(scene.mission.services)
    process = _signal(scene, service, signal.SIGSTOP)
    time.sleep(scene.rng.uniform(1.0, 8.0))
    if process is not None and process.is_running():
        process.send_signal(signal.SIGCONT)


def _await_replacement(scene: Scene, service: str, process: psutil.Process | None) -> None:
    """Wait until the supervisor has replaced a process."""
    if not wait_until(lambda: scene.mission.process(service) not in (None, process), _RESTARTED_S):
        scene.oracle.violate(f"{service}: not replaced within {_RESTARTED_S:g} s")


def _signal(scene: Scene, service: str, number: int) -> psutil.Process | None:
    """Send a signal to a service and return its process; None if it does not run now."""
    process = scene.mission.process(service)
    if process is not None:
        for robot in scene.mission.robots_of(service):
            scene.oracle.interrupt(robot)
        process.send_signal(number)
    return process
