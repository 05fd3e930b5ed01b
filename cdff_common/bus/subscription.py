# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A subscription with its own thread and a bounded ring, so that a slow consumer never blocks the session."""

from __future__ import annotations

import logging
import queue
import threading
from collections import deque
from collections.abc import Callable

import zenoh

from cdff_common.bus.message import Message

logger = logging.getLogger(__name__)


class Subscription:
    """Delivers messages to a callback in a thread of its own; when the ring is full the oldest is dropped and counted.

    Attributes
    ----------
    dropped : int
        Messages dropped since the start because the consumer was too slow.
    failed : int
        Messages whose callback raised; each is logged.
    """

    def __init__(self, session: zenoh.Session, keyexpr: str, callback: Callable[[Message], None], depth: int) -> None:
        self.dropped = 0
        self.failed = 0
        self._callback = callback
        self._depth = depth
        self._ring: deque[zenoh.Sample] = deque()
        self._ring_lock = threading.Lock()
        # One wake-up per message, and False at the end: a C queue wakes a thread several times faster than a Condition.
        self._wake: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=f"sub {keyexpr}", daemon=True)
        self._thread.start()
        # Straight on Zenoh's thread: ``_take`` only appends, and a thread in between would cost a switch per message.
        self._subscriber = session.declare_subscriber(keyexpr, zenoh.handlers.Callback(self._take, indirect=False))

    @property
    def pending(self) -> int:
        """Messages waiting in the ring."""
        return len(self._ring)

    def close(self) -> None:
        """Stop taking messages; those in the ring are discarded."""
        if self._closed:
            return
        self._closed = True
        self._subscriber.undeclare()
        self._wake.put(False)
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=2.0)

    def _take(self, sample: zenoh.Sample) -> None:
        with self._ring_lock:
            full = len(self._ring) >= self._depth
            if full:
                self._ring.popleft()
                self.dropped += 1
            self._ring.append(sample)
        if not full:  # a message that took the place of another uses its wake-up
            self._wake.put(True)

    def _run(self) -> None:
        while self._wake.get() and not self._closed:
            with self._ring_lock:
                sample = self._ring.popleft()
            message = Message(
                key=str(sample.key_expr),
                payload=sample.payload.to_bytes(),
                encoding=str(sample.encoding),
                attachment=b"" if sample.attachment is None else sample.attachment.to_bytes(),
            )
            try:
                self._callback(message)
            except Exception:  # the last line of defence of a thread: it is logged and counted
                self.failed += 1
                logger.exception("subscriber of %s failed", message.key)
