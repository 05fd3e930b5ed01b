# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A topic that a node of ROS 1 publishes."""

from __future__ import annotations

import logging
import threading
from collections import deque
from contextlib import suppress

from services.gateway_ros1.tcpros import Connection

logger = logging.getLogger(__name__)

#: Messages that wait for a slow subscriber; with more the oldest is dropped.
_QUEUE = 16
#: Interval of the checks that a subscriber is still there, seconds.
_IDLE_S = 1.0


class _Subscriber:
    """A connected subscriber and the messages that it has not received."""

    def __init__(self, name: str) -> None:
        self.name, self.waiting, self.changed = name, deque[bytes](maxlen=_QUEUE), threading.Condition()
        self.dropped = 0

    def append(self, data: bytes) -> bool:
        """Queue a message; return True if the oldest was dropped for it."""
        with self.changed:
            is_full = len(self.waiting) == _QUEUE
            self.dropped += is_full
            self.waiting.append(data)
            self.changed.notify()
        return is_full


class Publication:
    """Messages of a topic, for each subscriber in the thread of its connection.

    Parameters
    ----------
    topic, type_name, md5, definition : str
    latched : bool
        Send the last message to new subscribers.

    Attributes
    ----------
    dropped : int
        Messages that slow subscribers have not received.
    """

    def __init__(self, topic: str, type_name: str, md5: str, definition: str, *, latched: bool) -> None:
        self.topic, self.type_name, self.md5 = topic, type_name, md5
        self._definition, self._latched = definition, latched
        self._lock = threading.Lock()
        self._subscribers: list[_Subscriber] = []
        self._last: bytes | None = None
        self._closed = False
        self.dropped = 0

    def header(self) -> dict[str, str]:
        """Return the fields of the answer to a subscriber."""
        return {
            "topic": self.topic,
            "type": self.type_name,
            "md5sum": self.md5,
            "latching": str(int(self._latched)),
            "message_definition": self._definition,
        }

    def peers(self) -> list[str]:
        """Return the names of the subscribers."""
        with self._lock:
            return [subscriber.name for subscriber in self._subscribers]

    def publish(self, data: bytes) -> None:
        """Send a message to all subscribers."""
        with self._lock:
            self._last = data if self._latched else None
            subscribers = list(self._subscribers)
        for subscriber in subscribers:
            if subscriber.append(data):
                with self._lock:
                    self.dropped += 1
                if subscriber.dropped == 1:
                    logger.warning(
                        "%s: %s is too slow: more than %d messages wait, the oldest are dropped",
                        self.topic,
                        subscriber.name,
                        _QUEUE,
                    )

    def close(self) -> None:
        """End the threads of the subscribers."""
        self._closed = True
        with self._lock:
            subscribers = list(self._subscribers)
        for subscriber in subscribers:
            with subscriber.changed:
                subscriber.changed.notify()

    def serve(self, connection: Connection, asked: dict[str, str]) -> None:
        """Send messages to a subscriber until its connection ends."""
        subscriber = _Subscriber(asked.get("callerid", ""))
        with self._lock:
            self._subscribers.append(subscriber)
            if self._last is not None:
                subscriber.waiting.append(self._last)
        watcher = threading.Thread(target=_await_end, args=(connection, subscriber), daemon=True)
        watcher.start()
        try:
            while not self._closed and watcher.is_alive():
                with subscriber.changed:
                    subscriber.changed.wait_for(lambda: subscriber.waiting or self._closed, _IDLE_S)
                    data = subscriber.waiting.popleft() if subscriber.waiting else None
                if data is not None:
                    connection.send(data)
        finally:
            with self._lock:
                self._subscribers.remove(subscriber)


def _await_end(connection: Connection, subscriber: _Subscriber) -> None:
    """Return when the subscriber, which sends nothing after its header, closes the connection."""
    with suppress(OSError, EOFError):
        connection.receive_exactly(1)
    with subscriber.changed:
        subscriber.changed.notify()
