# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Samples of a log in order, encoded ahead of their time, from a position that can be changed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterator

from cdff_common.clock import NS_PER_S
from cdff_dev.logs.source import LogSource
from cdff_dev.play.prefetch import Item, Prefetch

#: Mission time for which samples are encoded before they are played, ns, and longest wait for that, seconds.
AHEAD_NS, AHEAD_TIMEOUT_S = 3 * NS_PER_S, 30.0


class Feed:
    """Items of some streams of a log. ``request`` is called from any thread, all else from one thread.

    Parameters
    ----------
    log : LogSource
    streams : collection of str
    is_needed : callable
        ``is_needed(robot, sensor)`` returns True if samples of the sensor are encoded ahead.
    capacity_bytes : int
        Size of the samples that are read ahead.
    """

    def __init__(
        self,
        log: LogSource,
        streams: Collection[str],
        is_needed: Callable[[str, str], bool],
        capacity_bytes: int,
    ) -> None:
        self._log, self._streams = log, streams
        self._is_needed, self._capacity_bytes = is_needed, capacity_bytes
        self._prefetch: Prefetch | None = None
        self._lock = threading.Lock()
        self._requested_ns: int | None = None
        self._is_filling = False

    def items_from(self, stamp_ns: int) -> Iterator[Item]:
        """Return the items at or after a stamp, once the first of them are encoded."""
        self._is_filling = True
        try:
            self.close()
            samples = self._log.samples_from(stamp_ns, self._streams)
            self._prefetch = Prefetch(samples, self._is_needed, self._capacity_bytes)
            self._prefetch.wait_filled(AHEAD_NS, AHEAD_TIMEOUT_S)
        finally:
            self._is_filling = False
        return iter(self._prefetch)

    def request(self, stamp_ns: int) -> None:
        """Request another position; of several requests the last one counts."""
        with self._lock:
            self._requested_ns = stamp_ns

    @property
    def is_requested(self) -> bool:
        """True if another position is requested and not taken."""
        with self._lock:
            return self._requested_ns is not None

    @property
    def is_ready(self) -> bool:
        """True if no other position is requested or being read."""
        with self._lock:
            return self._requested_ns is None and not self._is_filling

    def take_request(self) -> int | None:
        """Return the position that a seek requested, or None, and clear the request."""
        with self._lock:
            requested_ns, self._requested_ns = self._requested_ns, None
            self._is_filling = requested_ns is not None
            return requested_ns

    def close(self) -> None:
        """End the thread that reads ahead."""
        if self._prefetch is not None:
            self._prefetch.close()
