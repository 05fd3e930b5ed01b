# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Time, locks and threads of the orchestrator, replaceable by those of a simulation.

All waiting uses objects from a ``Timing``. ``cdff_dev.mission_replay.virtual`` simulates a day
with the same code in a minute: one thread at a time, in an order that depends only on a seed.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue
from typing import Any

from cdff_common.bus import Signal
from cdff_common.clock import monotonic_s


class Timing:
    """System time and threads."""

    def now_s(self) -> float:
        """Return monotonic seconds."""
        return monotonic_s()

    def event(self) -> threading.Event:
        """Return an event."""
        return threading.Event()

    def signal(self) -> Signal:
        """Return a signal, for which a request can wait without a thread."""
        return Signal(self.event())

    def condition(self) -> threading.Condition:
        """Return a condition."""
        return threading.Condition()

    def lock(self) -> threading.Lock:
        """Return a lock whose acquisition can have a timeout."""
        return threading.Lock()

    def queue(self) -> SimpleQueue[Any]:
        """Return a queue between threads."""
        return SimpleQueue()

    def start(self, target: Callable[[], None], name: str) -> threading.Thread:
        """Run ``target`` in a daemon thread."""
        thread = threading.Thread(target=target, name=name, daemon=True)
        thread.start()
        return thread

    def pool(self, workers: int, name: str) -> ThreadPoolExecutor:
        """Return a pool of threads for blocking calls."""
        return ThreadPoolExecutor(workers, thread_name_prefix=name)


REAL = Timing()
