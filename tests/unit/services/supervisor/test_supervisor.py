# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replacement of hung processes and bounded restarts of failing ones: real processes, short limits."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from services.supervisor import starvation
from services.supervisor.child import Child, Limits
from services.supervisor.plan import ProcessSpec
from services.supervisor.starvation import Starvation
from services.supervisor.supervisor import Supervisor

HEALTHY = (
    "from cdff_common.process import run_service\n"
    "raise SystemExit(run_service('x', lambda stop: stop.wait()))"
)
DEAD_LOOP = (
    "from cdff_common.heartbeat import add_check; from cdff_common.process import run_service\n"
    "add_check(lambda: 'loop watcher has ended')\n"
    "raise SystemExit(run_service('x', lambda stop: stop.wait()))"
)


def spec(name: str, code: str) -> ProcessSpec:
    return ProcessSpec(name, (sys.executable, "-c", code), {}, ())


@contextmanager
def running(supervisor: Supervisor) -> Iterator[Supervisor]:
    stop = threading.Event()
    thread = threading.Thread(target=supervisor.run, args=(stop,))
    thread.start()
    try:
        yield supervisor
    finally:
        stop.set()
        thread.join(10)


def wait_until(condition: Callable[[], object], timeout_s: float = 20.0) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, "the condition did not hold in time"
        time.sleep(0.02)


def test_a_stopped_process_is_replaced_after_the_limit_of_silence() -> None:
    supervisor = Supervisor([spec("service", HEALTHY)], limits=Limits(silence_s=2.0))
    with running(supervisor):
        wait_until(lambda: "service" in supervisor.children and supervisor.children["service"].has_beaten)
        child = supervisor.children["service"]
        assert child.process is not None
        first = child.process.pid
        os.kill(first, signal.SIGSTOP)
        wait_until(lambda: child.process is not None and child.process.pid != first and child.has_beaten)
        (alarm,) = supervisor.alarms.active()
        assert (alarm.kind, alarm.source) == ("hung_process", "service")
        assert "no heartbeat" in alarm.what


def test_a_crash_loop_raises_an_alarm_and_restarts_at_long_intervals_beside_healthy_processes() -> None:
    limits = Limits(backoff_first_s=0.01, backoff_longest_s=0.05, crash_loop_failures=3)
    supervisor = Supervisor([spec("broken", "raise SystemExit(3)"), spec("service", HEALTHY)], limits=limits)
    with running(supervisor):
        wait_until(lambda: supervisor.alarms.active() and supervisor.children["service"].has_beaten)
        (alarm,) = supervisor.alarms.active()
        assert (alarm.kind, alarm.source) == ("crash_loop", "broken")
        assert "code 3" in alarm.what
        child = supervisor.children["broken"]
        assert child.restarts == 3
        assert child.start_at_s - time.monotonic() > limits.crash_loop_wait_s / 2
        assert supervisor.children["service"].process is not None


def test_a_process_with_a_dead_loop_ends_and_is_replaced() -> None:
    supervisor = Supervisor([spec("service", DEAD_LOOP)])
    with running(supervisor):
        wait_until(lambda: "service" in supervisor.children and supervisor.children["service"].restarts >= 1)


def test_a_crash_loop_is_over_after_a_long_run() -> None:
    child = Child(spec("service", HEALTHY), Limits())
    waits_s = []
    for i in range(6):
        child.started_s = i * 22.0
        waits_s.append(child.add_failure(child.started_s + 20.0))
    assert waits_s[:2] == [0.2, 0.2], "each run was stable"
    assert waits_s[4:] == [60.0, 60.0]
    child.started_s = 200.0
    assert not child.has_recovered(310.0)
    assert child.has_recovered(330.0)
    assert not child.in_crash_loop
    assert child.add_failure(340.0) == pytest.approx(0.2)


def test_a_process_that_waits_for_a_processor_is_not_hung(monkeypatch: pytest.MonkeyPatch) -> None:
    waits_s = {"1": 3.0, "2": 100.0}
    monkeypatch.setattr(starvation, "waits_s", lambda _pid: dict(waits_s))
    monkeypatch.setattr(starvation, "_READ_S", 0.0)
    child = Child(spec("service", HEALTHY), Limits(silence_s=15.0), has_beaten=True)
    child.process = subprocess.Popen(["true"])
    child.process.wait()
    for second in range(40):
        assert child.listen(1.0) == "", second
        waits_s["1"] += 0.7  # displaced by other programs for 70 % of the time
    while not (hung := child.listen(1.0)):  # sleeps, and no longer waits for a processor
        pass
    assert hung == "service sent no heartbeat for 43 s"


@pytest.mark.slow
def test_only_a_process_that_is_ready_to_run_waits_for_a_processor() -> None:
    processor = min(os.sched_getaffinity(0))
    code = f"import os; os.sched_setaffinity(0, {{{processor}}})\nwhile True: pass"
    busy = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(3)]
    try:
        time.sleep(0.5)
        busy[0].send_signal(signal.SIGSTOP)
        time.sleep(0.2)
        waiting = [Starvation(process.pid) for process in busy]
        time.sleep(2.5)
        stopped_s, *displaced_s = (process.waited_s() for process in waiting)
        assert stopped_s < 0.1
        assert sum(displaced_s) > 0.8
    finally:
        for process in busy:
            process.kill()
            process.wait()


def test_a_stop_of_the_supervisor_is_no_silence_of_its_processes() -> None:
    child = Child(spec("service", HEALTHY), Limits(silence_s=2.0), has_beaten=True)
    assert not child.listen(1.0)
    assert not child.listen(1.0)
    assert "no heartbeat" in child.listen(0.1)


def test_a_large_log_is_rotated_while_the_process_writes(tmp_path: Path) -> None:
    log = tmp_path / "service.log"
    child = Child(spec("service", HEALTHY), Limits(log_bytes=100, logs_kept=2), log=log)
    with log.open("ab") as output:
        for text in ("first", "second", "third", "fourth"):
            output.write(text.encode() * 30)
            output.flush()
            child.rotate_log()
        output.write(b"last")
    assert log.read_text() == "last"
    names = {path.name: path.read_text()[:3] for path in tmp_path.iterdir()}
    assert names == {"service.log": "las", "service.log.1": "fou", "service.log.2": "thi"}
