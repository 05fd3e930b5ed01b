# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Subscription with its own thread and a bounded ring buffer; a slow consumer never blocks the session."""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import zenoh

from cdff_common.bus.message import Message
from cdff_common.loops import Loops


class Subscription:
    """Delivery of messages to a callback in a separate thread.

    When the ring buffer is full, the oldest message is dropped and counted.

    Attributes
    ----------
    dropped : int
        Number of messages dropped because the consumer was too slow.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keyexpr: str,
        callback: Callable[[Message], None],
        depth: int,
        loops: Loops,
    ) -> None:
        self.dropped = 0
        self._loops = loops
        self._loop = loops.add(f"sub {keyexpr}")
        self._callback = callback
        self._depth = depth
        self._ring: deque[zenoh.Sample] = deque()
        self._ring_lock = threading.Lock()
        # One wake-up per message, and False at the end: a C queue is several times faster than a Condition.
        self._wake: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._closed = False
        self._thread = threading.Thread(
            target=self._loop.run, args=(self._next, self._deliver), name=self._loop.name, daemon=True
        )
        self._thread.start()
        # In the thread of Zenoh: ``_take`` only appends, and another thread would cost a switch per message.
        self._subscriber = self._declare(session, keyexpr)

    def _declare(self, session: zenoh.Session, keyexpr: str) -> Any:
        return session.declare_subscriber(keyexpr, zenoh.handlers.Callback(self._take, indirect=False))

    @property
    def failed(self) -> int:
        """Number of messages whose callback raised; each is logged."""
        return self._loop.errors

    def close(self) -> None:
        """Stop the delivery; messages in the ring buffer are discarded."""
        if self._closed:
            return
        self._closed = True
        self._subscriber.undeclare()
        self._wake.put(False)
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=2.0)
        self._loops.remove(self._loop)

    def finish(self, timeout_s: float) -> None:
        """Stop the subscription after its callback has received the messages that have arrived."""
        self._subscriber.undeclare()
        self._wake.put(False)
        self._thread.join(timeout_s)
        self._closed = True
        self._loops.remove(self._loop)

    def _take(self, sample: zenoh.Sample) -> None:
        """Put a sample into the ring; if it is full, the oldest one is dropped and counted."""
        with self._ring_lock:
            full = len(self._ring) >= self._depth
            if full:
                self._ring.popleft()
                self.dropped += 1
            self._ring.append(sample)
        if not full:  # a message that replaced another uses its wake-up
            self._wake.put(True)

    def _next(self) -> zenoh.Sample | None:
        if not self._wake.get() or self._closed:
            return None
        with self._ring_lock:
            return self._ring.popleft()

    def _deliver(self, sample: zenoh.Sample) -> None:
        """Pass a sample to the callback as a message."""
        self._callback(
            Message(
                key=str(sample.key_expr),
                payload=sample.payload.to_bytes(),
                encoding=str(sample.encoding),
                attachment=b"" if sample.attachment is None else sample.attachment.to_bytes(),
            )
        )
