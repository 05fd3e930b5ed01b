# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Few tasks of a handler pool run at the same time, and those that wait let others run."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from cdff_common.bus.handler_pool import HandlerPool, waiting

TIMEOUT_S = 20.0


class Tasks:
    """Tasks that run until they are allowed to end."""

    def __init__(self) -> None:
        self.lock, self.running, self.most, self.ended = threading.Lock(), 0, 0, threading.Semaphore(0)
        self.begun = threading.Semaphore(0)

    def run(self, work: Callable[[], object]) -> None:
        with self.lock:
            self.running += 1
            self.most = max(self.most, self.running)
        self.begun.release()
        work()
        with self.lock:
            self.running -= 1
        self.ended.release()

    def wait(self, semaphore: threading.Semaphore, count: int) -> None:
        for _ in range(count):
            assert semaphore.acquire(timeout=TIMEOUT_S)


@pytest.fixture
def tasks() -> Tasks:
    return Tasks()


@pytest.mark.parametrize("count", [1, 2, 50])
def test_every_task_runs_and_at_most_two_at_once(tasks: Tasks, count: int) -> None:
    pool = HandlerPool(8, 2, "test")
    for _ in range(count):
        pool.submit(tasks.run, threading.Event().is_set)
    tasks.wait(tasks.ended, count)
    assert tasks.most <= 2
    pool.close()


def test_tasks_that_wait_let_others_run_up_to_the_number_of_threads(tasks: Tasks) -> None:
    pool, may_end = HandlerPool(5, 2, "test"), threading.Event()

    def wait() -> None:
        with waiting():
            assert may_end.wait(TIMEOUT_S)

    for _ in range(9):
        pool.submit(tasks.run, wait)
    tasks.wait(tasks.begun, 5)
    assert not tasks.begun.acquire(timeout=0.1)
    may_end.set()
    tasks.wait(tasks.ended, 9)
    for _ in range(20):  # the number of running tasks is right again
        pool.submit(tasks.run, threading.Event().is_set)
    tasks.wait(tasks.ended, 20)
    pool.close()


def test_tasks_run_in_the_order_of_their_submission() -> None:
    pool, order, all_done = HandlerPool(4, 1, "test"), list[int](), threading.Event()
    for number in range(100):
        pool.submit(order.append, number)
    pool.submit(all_done.set)
    assert all_done.wait(TIMEOUT_S)
    assert order == list(range(100))
    pool.close()


def test_a_task_that_fails_stops_no_other(tasks: Tasks, caplog: pytest.LogCaptureFixture) -> None:
    pool = HandlerPool(1, 1, "test")
    pool.submit(lambda: 1 / 0)
    pool.submit(tasks.run, threading.Event().is_set)
    tasks.wait(tasks.ended, 1)
    assert "a task of the pool test failed" in caplog.text
    pool.close()


def test_submitted_tasks_run_after_close_and_further_ones_are_refused(tasks: Tasks) -> None:
    pool, may_end = HandlerPool(3, 1, "test"), threading.Event()
    pool.submit(tasks.run, lambda: may_end.wait(TIMEOUT_S))
    for _ in range(5):
        pool.submit(tasks.run, threading.Event().is_set)
    pool.close()
    with pytest.raises(RuntimeError, match="the pool test is closed"):
        pool.submit(tasks.run, threading.Event().is_set)
    may_end.set()
    tasks.wait(tasks.ended, 6)


def test_threads_end_after_close() -> None:
    pool, barrier = HandlerPool(4, 4, "ending"), threading.Barrier(5)
    for _ in range(4):
        pool.submit(barrier.wait, TIMEOUT_S)
    barrier.wait(TIMEOUT_S)
    pool.close()
    for thread in [t for t in threading.enumerate() if t.name.startswith("ending_")]:
        thread.join(TIMEOUT_S)
        assert not thread.is_alive()


def test_waiting_outside_of_a_pool_has_no_effect() -> None:
    with waiting():
        pass
