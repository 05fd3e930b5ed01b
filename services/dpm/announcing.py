# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What every operation of the DPM shares: the store, counters, and listeners that are told what became durable."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

from cdff_common.clock import Clock
from dpm_store import Event, Store
from services.dpm.checks import FrameNames


class Announcing:
    """A store whose events are told to listeners.

    Parameters
    ----------
    store : Store
    max_payload_bytes : int
        Larger insertions are refused.
    """

    def __init__(self, store: Store, max_payload_bytes: int = 256 << 20) -> None:
        self.store = store
        self.max_payload_bytes = max_payload_bytes
        self._lock = threading.Lock()
        self._frames = FrameNames(store)
        self._listeners: list[Callable[[Event], None]] = []
        #: What others of this process count, told with the status.
        self.counted: dict[str, Callable[[], Mapping[str, int]]] = {}
        self._told = store.events.last_ordinal()
        self.counters = {
            "inserted": 0,
            "already": 0,
            "refused": 0,
            "updated": 0,
            "deleted": 0,
            "searches": 0,
            "gets": 0,
            "windows": 0,
        }

    @property
    def clock(self) -> Clock:
        """Mission clock."""
        return self.store.clock

    def listen(self, listener: Callable[[Event], None]) -> None:
        """Call ``listener`` with every event from now on, in order, after it is durable."""
        with self._lock:
            self._listeners.append(listener)

    def unlisten(self, listener: Callable[[Event], None]) -> None:
        """Stop calling ``listener``."""
        with self._lock:
            self._listeners = [known for known in self._listeners if known is not listener]

    def _count(self, what: str) -> None:
        with self._lock:
            self.counters[what] += 1

    def _tell(self) -> None:
        with self._lock:
            while events := self.store.events.since(self._told):
                self._told = events[-1].ordinal
                for event in events:
                    for listener in self._listeners:
                        listener(event)
