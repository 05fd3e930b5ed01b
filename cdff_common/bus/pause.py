# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pauses of calls: a handler that waits between its replies occupies no thread.

A handler yields a ``Pause`` instead of a reply. The server continues it in its pool after the signal of the
pause is set, or after its time.
"""

from __future__ import annotations

import heapq
import itertools
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from cdff_common.bus.message import Reply
from cdff_common.clock import monotonic_s
from cdff_common.loops import Loops


@dataclass(slots=True, eq=False)
class Signal:
    """An event for one waiting thread, or for one call that is paused.

    Attributes
    ----------
    event : Event
        By default one of the system; of a simulation in virtual time.
    """

    event: threading.Event = field(default_factory=threading.Event)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _listener: Callable[[], None] | None = None

    def set(self) -> None:
        """Set the event, and call the listener once."""
        with self._lock:
            self.event.set()
            listener, self._listener = self._listener, None
        if listener is not None:
            listener()

    def clear(self) -> None:
        """Reset the event."""
        self.event.clear()

    def is_set(self) -> bool:
        """Return whether the event is set."""
        return self.event.is_set()

    def wait(self, timeout_s: float) -> bool:
        """Wait for the event; return whether it is set."""
        return self.event.wait(timeout_s)

    def listen(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` when the event is set, or now if it is; it replaces the last one."""
        with self._lock:
            if not self.event.is_set():
                self._listener = listener
                return
        listener()


@dataclass(frozen=True, slots=True)
class Pause:
    """Wait of a handler for a signal, at most for ``timeout_s`` seconds."""

    signal: Signal
    timeout_s: float

    def wait(self) -> None:
        """Wait in this thread."""
        self.signal.wait(max(self.timeout_s, 0.0))


def without_pauses(items: Iterable[Reply | Pause]) -> Iterator[Reply]:
    """Yield the replies of a handler, and wait in this thread where it pauses."""
    for item in items:
        if isinstance(item, Pause):
            item.wait()
        else:
            yield item


@dataclass(slots=True, eq=False)
class _Paused:
    """A paused call: continued once, by its signal or its time."""

    proceed: Callable[[], None]
    lock: threading.Lock = field(default_factory=threading.Lock)
    is_done: bool = False

    def __call__(self) -> None:
        with self.lock:
            if self.is_done:
                return
            self.is_done = True
        self.proceed()


class _Entry(NamedTuple):
    """A paused call in the queue, which is ordered by time, then by number."""

    end_s: float
    number: int
    call: _Paused


class PausedCalls:
    """Paused calls of one process, and the thread that continues those whose time is over.

    Parameters
    ----------
    loops : Loops
        Checks the thread, which starts with the first pause.
    """

    def __init__(self, loops: Loops) -> None:
        self._loops = loops
        self._changed = threading.Condition()
        self._calls: list[_Entry] = []
        self._numbers = itertools.count()
        self._thread: threading.Thread | None = None
        self._is_closed = False

    def add(self, pause: Pause, proceed: Callable[[], None]) -> None:
        """Call ``proceed`` once, after a pause; it must not block."""
        paused = _Paused(proceed)
        if pause.timeout_s > 0.0:
            with self._changed:
                if self._thread is None and not self._is_closed:
                    self._start()
                entry = _Entry(monotonic_s() + pause.timeout_s, next(self._numbers), paused)
                heapq.heappush(self._calls, entry)
                if self._calls[0] is entry:
                    self._changed.notify()
            pause.signal.listen(paused)
        else:
            paused()

    def close(self) -> None:
        """End the thread; paused calls are continued only by their signals."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()

    def _start(self) -> None:
        loop = self._loops.add("paused calls")

        def run() -> None:
            loop.run(self._next, lambda paused: paused())

        self._thread = threading.Thread(target=run, name=loop.name, daemon=True)
        self._thread.start()

    def _next(self) -> _Paused | None:
        """Return the next call whose time is over; None when closed."""
        with self._changed:
            while not self._is_closed and (not self._calls or self._calls[0].end_s > monotonic_s()):
                wait_s = self._calls[0].end_s - monotonic_s() if self._calls else None
                self._changed.wait(wait_s)
            return None if self._is_closed else heapq.heappop(self._calls).call
