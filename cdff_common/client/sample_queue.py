# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Samples that wait for the link: a queue of limited length, and the thread that sends them."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class EncodedSample:
    """Sample as it is sent: payload, encoding string and attachment."""

    payload: bytes
    encoding: str
    attachment: bytes


class SampleQueue:
    """Queue of encoded samples; while the link is busy, the oldest waiting sample is dropped and counted.

    Parameters
    ----------
    name : str
        Name of the stream, for logs.
    depth : int
        Largest number of waiting samples.
    send : callable
        Sends a sample; it may wait for the link.
    """

    def __init__(self, name: str, depth: int, send: Callable[[EncodedSample], None]) -> None:
        self._name, self._depth, self._send = name, depth, send
        self._waiting: deque[EncodedSample] = deque()
        self._changed = threading.Condition()
        self._is_closed = self._is_sending = False
        self.sent = self.dropped = 0
        self._thread = threading.Thread(target=self._run, name=f"publish {name}", daemon=True)
        self._thread.start()

    def put(self, sample: EncodedSample) -> None:
        """Append a sample; drop the oldest one if the queue is full."""
        with self._changed:
            if len(self._waiting) >= self._depth:
                self._waiting.popleft()
                self.dropped += 1
                if self.dropped.bit_count() == 1:  # the 1st, 2nd, 4th, 8th, …
                    logger.warning("%s: %d samples dropped; the link is busy", self._name, self.dropped)
            self._waiting.append(sample)
            self._changed.notify_all()

    def flush(self, timeout_s: float) -> bool:
        """Wait until all samples are sent; return False after ``timeout_s``."""
        until_s = monotonic_s() + timeout_s
        with self._changed:
            while self._waiting or self._is_sending:
                if (remaining_s := until_s - monotonic_s()) <= 0 or not self._thread.is_alive():
                    return False
                self._changed.wait(remaining_s)
        return True

    def close(self, timeout_s: float) -> None:
        """Send the waiting samples for at most ``timeout_s``, then end the thread."""
        self.flush(timeout_s)
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        self._thread.join(timeout_s)

    def _run(self) -> None:
        """Send the waiting samples until the queue is closed."""
        while True:
            with self._changed:
                self._is_sending = False
                self._changed.notify_all()
                while not self._waiting and not self._is_closed:
                    self._changed.wait()
                if self._is_closed:
                    return
                sample = self._waiting.popleft()
                self._is_sending = True
            try:
                self._send(sample)
                self.sent += 1
            except CdffError as error:  # the bus is closed
                self.dropped += 1
                logger.warning("%s: a sample is not sent: %s", self._name, error)
