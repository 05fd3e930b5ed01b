# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Threads for handlers, of which few run at the same time: more would only wait for the interpreter's lock.

A handler that waits for the answer of another service lets the next one run, so that slow answers of one
service do not stop all handlers.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

logger = logging.getLogger(__name__)

_local = threading.local()


class HandlerPool:
    """Threads that execute tasks in the order of their submission.

    Parameters
    ----------
    workers : int
        Largest number of threads.
    running : int
        Number of tasks that run at the same time, apart from those that are ``waiting``.
    name : str
        Prefix of the names of the threads.
    """

    def __init__(self, workers: int, running: int, name: str) -> None:
        self._workers, self._limit, self._name = workers, running, name
        self._changed = threading.Condition()
        self._tasks: deque[tuple[Callable[..., object], tuple[Any, ...]]] = deque()
        self._threads = 0
        self._running = 0  # tasks that run, and threads that are about to take one
        self._idle = 0
        self._woken = 0  # idle threads that are about to take a task
        self._is_closed = False

    def submit(self, function: Callable[..., object], *arguments: object) -> None:
        """Call a function in a thread; raises RuntimeError after ``close``."""
        with self._changed:
            if self._is_closed:
                raise RuntimeError(f"the pool {self._name} is closed")
            self._tasks.append((function, arguments))
            self._wake()

    def close(self) -> None:
        """Accept no further tasks, and end the threads after the submitted ones."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def _wake(self) -> None:
        """Let a thread take the next task if the limits permit; the lock is held."""
        if not self._tasks or self._running >= self._limit:
            return
        if self._idle > self._woken:
            self._woken += 1
            self._changed.notify()
        elif self._threads < self._workers:
            thread = threading.Thread(target=self._run, name=f"{self._name}_{self._threads}", daemon=True)
            self._threads += 1
            thread.start()
        else:
            return
        self._running += 1

    def _run(self) -> None:
        """Execute tasks on this thread until the pool ends; errors of a task are logged."""
        _local.pool = self
        while (task := self._next()) is not None:
            function, arguments = task
            try:
                function(*arguments)
            except Exception:
                logger.exception("a task of the pool %s failed", self._name)
            del task, function, arguments  # nothing is kept while the thread is idle

    def _next(self) -> tuple[Callable[..., object], tuple[Any, ...]] | None:
        """Return the next task; None when the thread shall end. The thread counts as running."""
        with self._changed:
            while self._running > self._limit or not self._tasks:
                self._running -= 1
                if self._is_closed:
                    return None
                self._idle += 1
                self._changed.wait_for(lambda: self._woken > 0 or self._is_closed)
                self._idle -= 1
                if self._woken:  # ``_wake`` has counted it as running
                    self._woken -= 1
                else:
                    self._running += 1
            return self._tasks.popleft()

    @contextmanager
    def waiting(self) -> Iterator[None]:
        """Let other tasks run while the one of this thread waits."""
        with self._changed:
            self._running -= 1
            self._wake()
        try:
            yield
        finally:
            with self._changed:
                self._running += 1


@contextmanager
def waiting() -> Iterator[None]:
    """Let other tasks of the pool of this thread run, if it has one, while this one waits."""
    pool: HandlerPool | None = getattr(_local, "pool", None)
    if pool is None:
        yield
    else:
        with pool.waiting():
            yield
