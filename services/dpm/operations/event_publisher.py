# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Publication of durable events to listeners, and counters of operations."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

from dpm_store import Event, Store

_COUNTERS = ("inserted", "already", "refused", "skewed", "updated", "deleted", "searches", "gets", "windows")


class EventPublisher:
    """Calls listeners with every event of a store, in order, once it is durable.

    Attributes
    ----------
    counters : dict of str to int
        Operations since the start.
    other_counters : dict of str to callable
        Counters of other components of this process, reported with the status.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._listeners: list[Callable[[Event], None]] = []
        self._last_published = store.events.last_ordinal()
        self.counters = dict.fromkeys(_COUNTERS, 0)
        self.other_counters: dict[str, Callable[[], Mapping[str, int]]] = {}

    def listen(self, listener: Callable[[Event], None]) -> None:
        """Call ``listener`` with every event from now on."""
        with self._lock:
            self._listeners.append(listener)

    def unlisten(self, listener: Callable[[Event], None]) -> None:
        """Stop calling ``listener``."""
        with self._lock:
            self._listeners = [known for known in self._listeners if known is not listener]

    def count(self, counter: str) -> None:
        """Increment a counter."""
        with self._lock:
            self.counters[counter] += 1

    def publish(self) -> None:
        """Publish every event that became durable since the last call."""
        with self._lock:
            while events := self._store.events.since(self._last_published):
                self._last_published = events[-1].ordinal
                for event in events:
                    for listener in self._listeners:
                        listener(event)
