# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Virtual time for code that waits: threads of which only one runs at a time, in a fixed order.

Each thread is a task. A waiting task has a condition and a timeout. The scheduler runs the first task whose
condition holds; only if there is none, it advances the clock to the next timeout.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from services.orchestrator.timing import Timing


class Task:
    """A thread of the simulation.

    Attributes
    ----------
    process : object
        Simulated process to which the task belongs.
    resume : Semaphore
        Released by the scheduler to let the thread run.
    ready : callable
        Condition for which the task waits.
    until_s : float
        Virtual time at which the wait ends even if the condition does not hold.
    """

    def __init__(self, name: str, process: object) -> None:
        self.name, self.process = name, process
        self.resume = threading.Semaphore(0)
        self.ready: Callable[[], bool] = lambda: True
        self.until_s = math.inf
        self.done = False
        self.error: BaseException | None = None


class Scheduler:
    """Runs tasks one at a time; ``now_s`` is the virtual time."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.tasks: list[Task] = []
        self.current: Task | None = None
        self._yielded = threading.Semaphore(0)

    def start(self, target: Callable[[], None], name: str, process: object = None) -> Task:
        """Add a task; it runs in a later ``step``."""
        task = Task(name, process)

        def run() -> None:
            task.resume.acquire()
            try:
                target()
            except BaseException as error:  # noqa: BLE001 - raised again by ``step``
                task.error = error
            task.done = True
            self._yielded.release()

        threading.Thread(target=run, name=name, daemon=True).start()
        self.tasks.append(task)
        return task

    def block(self, ready: Callable[[], bool], timeout_s: float | None) -> bool:
        """Let the current task wait until ``ready()`` or a timeout; return ``ready()``."""
        if ready():
            return True
        task = self.current
        assert task is not None, "only a task can wait"
        # At least a microsecond: repeated waits of zero would stop the clock.
        task.ready, task.until_s = ready, math.inf if timeout_s is None else self.now_s + max(timeout_s, 1e-6)
        self._yielded.release()
        task.resume.acquire()
        return ready()

    def sleep(self, seconds: float) -> None:
        """Let the current task wait for virtual seconds."""
        self.block(lambda: False, seconds)

    def kill(self, process: object) -> None:
        """Remove the tasks of a process, as if it were killed."""
        self.tasks = [t for t in self.tasks if t.process is not process]

    def step(self) -> bool:
        """Let one task run until it waits or ends; return False if no task can run any more."""
        chosen = next((t for t in self.tasks if t.ready()), None)
        if chosen is None:
            chosen = min(self.tasks, key=lambda t: t.until_s, default=None)
            if chosen is None or chosen.until_s == math.inf:
                return False
            self.now_s = max(self.now_s, chosen.until_s)
        # The task moves to the end of the queue, so that every task gets its turn.
        self.tasks.remove(chosen)
        self.tasks.append(chosen)
        chosen.ready, chosen.until_s = (lambda: False), math.inf
        self.current = chosen
        chosen.resume.release()
        self._yielded.acquire()
        self.current = None
        if chosen.done:
            self.tasks = [t for t in self.tasks if t is not chosen]
        if chosen.error is not None:
            raise chosen.error
        return True

    def is_waiting(self, name: str, process: object) -> bool:
        """Return True if all tasks of this name and process wait for conditions that do not hold.

        Return False if there is no such task, as after the end of the process.
        """
        tasks = [t for t in self.tasks if t.name == name and t.process is process]
        return bool(tasks) and not any(t.ready() for t in tasks)


class _Lock:
    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler, self._held = scheduler, False

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        is_acquired = self._scheduler.block(lambda: not self._held, None if timeout < 0 else timeout)
        self._held = self._held or is_acquired
        return is_acquired

    def release(self) -> None:
        self._held = False

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *exc: object) -> None:
        self.release()


class _Condition:
    """A condition without a lock: between two waits only one task runs."""

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
    """Clock and waiting objects of one process of the simulation, in virtual time."""

    def __init__(self, scheduler: Scheduler) -> None:
        self.scheduler = scheduler

    def now_s(self) -> float:
        """Return the virtual time, seconds."""
        return self.scheduler.now_s

    def event(self) -> threading.Event:
        """Return an event in virtual time."""
        return _Event(self.scheduler)  # type: ignore[return-value]

    def condition(self) -> threading.Condition:
        """Return a condition variable in virtual time."""
        return _Condition(self.scheduler)  # type: ignore[return-value]

    def lock(self) -> threading.Lock:
        """Return a lock in virtual time."""
        return _Lock(self.scheduler)  # type: ignore[return-value]

    def queue(self) -> Any:
        """Return a queue whose ``get`` waits in virtual time."""
        return _Queue(self.scheduler)

    def start(self, target: Callable[[], None], name: str) -> threading.Thread:
        """Start ``target`` as a task of this process."""
        return _Thread(self.scheduler, self.scheduler.start(target, name, self))  # type: ignore[return-value]

    def pool(self, workers: int, name: str) -> Any:
        """Return a pool that runs each call as a task."""
        return _Pool(self, name)
