# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Virtual time for code that waits: real threads of which one runs at a time, in a fixed order.

Each thread is a task. A waiting task states its condition and its timeout and yields; the scheduler runs the
first task whose wait is over, and moves the clock only when there is none.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from services.orchestrator.timing import Timing


class Task:
    """A thread of the simulation."""

    def __init__(self, name: str, process: object) -> None:
        self.name, self.process = name, process
        self.go = threading.Semaphore(0)
        self.ready: Callable[[], bool] = lambda: True
        self.until_s = math.inf
        self.done = False
        self.error: BaseException | None = None


class Scheduler:
    """Runs tasks one at a time and owns the clock."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.tasks: list[Task] = []
        self.current: Task | None = None
        self._back = threading.Semaphore(0)

    def start(self, target: Callable[[], None], name: str, process: object = None) -> Task:
        """Add a task; it runs when its turn comes."""
        task = Task(name, process)

        def run() -> None:
            task.go.acquire()
            try:
                target()
            except BaseException as error:  # noqa: BLE001 - raised again by ``step``
                task.error = error
            task.done = True
            self._back.release()

        threading.Thread(target=run, name=name, daemon=True).start()
        self.tasks.append(task)
        return task

    def block(self, ready: Callable[[], bool], timeout_s: float | None) -> bool:
        """Wait, as the task that runs, until ``ready`` or so much later; returns whether it is ready."""
        if ready():
            return True
        task = self.current
        assert task is not None, "only tasks wait"
        # At least a microsecond: a wait rounded to zero must not stop the clock.
        task.ready, task.until_s = ready, math.inf if timeout_s is None else self.now_s + max(timeout_s, 1e-6)
        self._back.release()
        task.go.acquire()
        return ready()

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        self.block(lambda: False, seconds)

    def kill(self, process: object) -> None:
        """Never let the tasks of a process run again, as when it is killed."""
        self.tasks = [t for t in self.tasks if t.process is not process]

    def step(self) -> bool:
        """Let one task run until it waits or ends; False if none ever will."""
        chosen = next((t for t in self.tasks if t.ready()), None)
        if chosen is None:
            chosen = min(self.tasks, key=lambda t: t.until_s, default=None)
            if chosen is None or chosen.until_s == math.inf:
                return False
            self.now_s = max(self.now_s, chosen.until_s)
        # To the end of the queue: no task starves.
        self.tasks.remove(chosen)
        self.tasks.append(chosen)
        chosen.ready, chosen.until_s = (lambda: False), math.inf
        self.current = chosen
        chosen.go.release()
        self._back.acquire()
        self.current = None
        if chosen.done:
            self.tasks = [t for t in self.tasks if t is not chosen]
        if chosen.error is not None:
            raise chosen.error
        return True

    def is_waiting(self, name: str, process: object) -> bool:
        """Return True if every task of that name waits for a condition that does not hold."""
        return all(not t.ready() for t in self.tasks if t.name == name and t.process is process)


class _Lock:
    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler, self._held = scheduler, False

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        free = self._scheduler.block(lambda: not self._held, None if timeout < 0 else timeout)
        self._held = self._held or free
        return free

    def release(self) -> None:
        self._held = False

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *exc: object) -> None:
        self.release()


class _Condition:
    """Between two waits only one task runs, so that it needs no lock."""

    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler = scheduler

    def __enter__(self) -> bool:
        return True

    def __exit__(self, *exc: object) -> None:
        pass

    def wait_for(self, predicate: Callable[[], bool], timeout: float | None = None) -> bool:
        return self._scheduler.block(predicate, timeout)

    def notify_all(self) -> None:
        pass


class _Event:
    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler, self._set = scheduler, False

    def set(self) -> None:
        self._set = True

    def clear(self) -> None:
        self._set = False

    def is_set(self) -> bool:
        return self._set

    def wait(self, timeout: float | None = None) -> bool:
        return self._scheduler.block(self.is_set, timeout)


class _Queue:
    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler, self._items = scheduler, deque[Any]()

    def put(self, item: Any) -> None:
        self._items.append(item)

    def get(self) -> Any:
        self._scheduler.block(lambda: bool(self._items), None)
        return self._items.popleft()


class _Thread:
    def __init__(self, scheduler: Scheduler, task: Task) -> None:
        self._scheduler, self._task = scheduler, task

    def join(self, timeout: float | None = None) -> None:
        self._scheduler.block(lambda: self._task.done, timeout)


class _Pool:
    def __init__(self, timing: VirtualTiming, name: str) -> None:
        self._timing, self._name = timing, name

    def submit(self, call: Callable[..., object], /, *arguments: Any) -> None:
        def run() -> None:
            call(*arguments)

        self._timing.start(run, self._name)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        pass


class VirtualTiming(Timing):
    """Time and waiting of one process of the simulation."""

    def __init__(self, scheduler: Scheduler) -> None:
        self.scheduler = scheduler

    def now_s(self) -> float:
        """Virtual seconds."""
        return self.scheduler.now_s

    def event(self) -> threading.Event:
        """Return an event in virtual time."""
        return _Event(self.scheduler)  # type: ignore[return-value]

    def condition(self) -> threading.Condition:
        """Return a condition in virtual time."""
        return _Condition(self.scheduler)  # type: ignore[return-value]

    def lock(self) -> threading.Lock:
        """Return a lock whose acquisition can have a timeout."""
        return _Lock(self.scheduler)  # type: ignore[return-value]

    def queue(self) -> Any:
        """Return a queue between tasks."""
        return _Queue(self.scheduler)

    def start(self, target: Callable[[], None], name: str) -> threading.Thread:
        """Run ``target`` as a task of this process."""
        return _Thread(self.scheduler, self.scheduler.start(target, name, self))  # type: ignore[return-value]

    def pool(self, workers: int, name: str) -> Any:
        """Return a pool that runs each call as a task."""
        return _Pool(self, name)
