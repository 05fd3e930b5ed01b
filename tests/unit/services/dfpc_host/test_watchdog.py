# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The watchdog ends steps that stall or never end, and no slow ones."""

from __future__ import annotations

import threading
import time

import pytest

from services.dfpc_host.watchdog import ENDLESS_TIMEOUTS, StepWatchdog, ThreadTimes

TIMEOUT_S = 10.0


def test_a_step_on_a_slow_machine_is_not_ended() -> None:
    watchdog = StepWatchdog(TIMEOUT_S)
    # A twentieth of a CPU, and waiting for one otherwise.
    for now_s in range(200):
        assert not watchdog.problem(0.0, float(now_s), ThreadTimes(now_s / 20, float(now_s)))


@pytest.mark.parametrize("first_s", [0.0, 8000.0])
def test_a_step_that_waits_is_ended_after_the_timeout(first_s: float) -> None:
    watchdog = StepWatchdog(TIMEOUT_S)
    waiting = ThreadTimes(3.0, 4.0)
    assert not any(watchdog.problem(first_s, first_s + t, waiting) for t in range(11))
    assert "without computing" in watchdog.problem(first_s, first_s + 10.5, waiting)


def test_a_new_step_has_the_whole_timeout() -> None:
    watchdog, waiting = StepWatchdog(TIMEOUT_S), ThreadTimes(3.0, 4.0)
    assert not watchdog.problem(0.0, 0.0, waiting)
    assert not watchdog.problem(9.0, 9.0, waiting)
    assert not watchdog.problem(9.0, 18.0, waiting)
    assert not watchdog.problem(None, 100.0, waiting)
    assert not watchdog.problem(101.0, 101.0, waiting)


def test_a_step_is_not_ended_after_its_machine_was_suspended() -> None:
    watchdog, waiting = StepWatchdog(TIMEOUT_S), ThreadTimes(3.0, 4.0)
    assert not any(watchdog.problem(0.0, float(now_s), waiting) for now_s in range(6))
    assert not watchdog.problem(0.0, 3600.0, waiting)
    assert not any(watchdog.problem(0.0, 3600.0 + t, waiting) for t in range(5))
    assert "without computing" in watchdog.problem(0.0, 3604.5, waiting)


def test_an_endless_step_is_ended_by_its_cpu_time() -> None:
    watchdog, limit_s = StepWatchdog(TIMEOUT_S), ENDLESS_TIMEOUTS * TIMEOUT_S
    assert not any(
        watchdog.problem(0.0, float(t), ThreadTimes(float(t), float(t))) for t in range(int(limit_s))
    )
    assert "does not end" in watchdog.problem(0.0, limit_s + 1, ThreadTimes(limit_s + 1, limit_s + 1))


def test_the_times_of_a_thread_tell_computing_from_waiting() -> None:
    end, busy_until_s = threading.Event(), time.monotonic() + 0.3

    def compute() -> None:
        while time.monotonic() < busy_until_s:
            sum(range(1000))
        end.wait()

    thread = threading.Thread(target=compute)
    thread.start()
    while time.monotonic() < busy_until_s + 0.05:
        time.sleep(0.01)
    computed = ThreadTimes.of(thread)
    time.sleep(0.2)
    waited = ThreadTimes.of(thread)
    end.set()
    thread.join()
    assert computed is not None
    assert waited is not None
    assert computed.runnable_s > 0.1
    assert waited.runnable_s - computed.runnable_s < 0.05
    assert ThreadTimes.of(threading.Thread()) is None
