# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A subscription with its own thread and a bounded ring, so that a slow consumer never blocks the session."""

from __future__ import annotations

import logging
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
        self._ring: deque[zenoh.Sample] = deque()
        self._depth = depth
        self._ready = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=f"sub {keyexpr}", daemon=True)
        self._thread.start()
        self._subscriber = session.declare_subscriber(keyexpr, self._take)

    @property
    def pending(self) -> int:
        """Messages waiting in the ring."""
        return len(self._ring)

    def close(self) -> None:
        """Stop taking messages; those in the ring are discarded."""
        with self._ready:
            if self._closed:
                return
            self._closed = True
            self._ready.notify()
        self._subscriber.undeclare()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=2.0)

    def _take(self, sample: zenoh.Sample) -> None:
        with self._ready:
            if len(self._ring) >= self._depth:
                self._ring.popleft()
                self.dropped += 1
            self._ring.append(sample)
            self._ready.notify()

    def _run(self) -> None:
        while True:
            with self._ready:
                while not self._ring and not self._closed:
                    self._ready.wait()
                if self._closed:
                    return
                sample = self._ring.popleft()
            message = Message(
                key=str(sample.key_expr),
                payload=sample.payload.to_bytes(),
                encoding=str(sample.encoding),
                attachment=b"" if sample.attachment is None else sample.attachment.to_bytes(),
            )
            try:
                self._callback(message)
            except Exception:  # noqa: BLE001  # the last line of defence of a thread: it is logged and counted
                self.failed += 1
                logger.exception("subscriber of %s failed", message.key)
