# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Time and waiting as the orchestrator's parts use them, in one place: a simulation can run them all in its own.

Everything that waits does so through what a ``Timing`` makes. ``services.rehearsal.virtual`` runs the same code over a
day in a minute, one thread at a time, in an order that a seed fixes.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue
from typing import Any

from cdff_common.clock import monotonic_s


class Timing:
    """Real time and real threads."""

    def now_s(self) -> float:
        """Monotonic seconds."""
        return monotonic_s()

    def event(self) -> threading.Event:
        """A flag to wait for."""
        return threading.Event()

    def condition(self) -> threading.Condition:
        """A lock, and a wait for what it guards."""
        return threading.Condition()

    def lock(self) -> threading.Lock:
        """A lock that can be waited for with a limit."""
        return threading.Lock()

    def queue(self) -> SimpleQueue[Any]:
        """A queue between threads."""
        return SimpleQueue()

    def start(self, target: Callable[[], None], name: str) -> threading.Thread:
        """Run ``target`` in a thread of its own that does not keep the process alive."""
        thread = threading.Thread(target=target, name=name, daemon=True)
        thread.start()
        return thread

    def pool(self, workers: int, name: str) -> ThreadPoolExecutor:
        """Threads for calls that wait."""
        return ThreadPoolExecutor(workers, thread_name_prefix=name)


REAL = Timing()
