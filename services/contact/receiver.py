# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reception of the items of one robot at the ground, and their acknowledgement.

Bytes of large items are written to files at their offset. An item is reported as done only after the commit
of the store that has it.
"""

from __future__ import annotations

import logging
import os
import threading
from collections import deque
from pathlib import Path
from typing import Any, NamedTuple

from cdff_common.errors import CdffError, CodecError, StorageError
from dpm_store.exchange.ledger import Ledger, PartRow, Ranges
from services.contact.arrivals import Arrivals
from services.contact.packets import (
    CHUNK_BYTES,
    MAX_RANGES,
    Item,
    Kind,
    add_range,
    item_of,
    missing_ranges,
    pack,
)

logger = logging.getLogger(__name__)

#: Acknowledgements in which each number and each key is repeated, so that the loss of some has no effect.
_REPEATS = 3
#: Keys and intervals in one acknowledgement.
_MAX_DONE, _MAX_WANTED = 60, 8
#: Packets that can be lost in a row: a greater number is not one of this session.
_MAX_AHEAD = 100_000
#: Largest item, bytes.
_MAX_BYTES = 1 << 30
#: Keys that are remembered as done.
_REMEMBERED = 20_000


class _Part(NamedTuple):
    total: int
    ranges: Ranges
    descriptor: int


class Receiver:
    """Items of one robot.

    Parameters
    ----------
    lock : RLock
        Held by the caller of each method but ``flush``.

    Attributes
    ----------
    heard_s : float
        Monotonic time of the last packet.
    bytes_received, bytes_repeated : int
        Item bytes since the start, and those of them that had been received before.
    """

    def __init__(
        self, robot: str, folder: Path, ledger: Ledger, arrivals: Arrivals, lock: threading.RLock
    ) -> None:
        self._lock = lock
        self._robot, self._folder, self._ledger, self._arrivals = robot, folder / robot, ledger, arrivals
        self._folder.mkdir(parents=True, exist_ok=True)
        self._parts: dict[int, _Part] = {}
        self._changed: set[int] = set()
        self._done: deque[tuple[int, int]] = deque()  # (key, remaining repeats)
        self._known: dict[int, None] = {}
        self._wanted: dict[int, Ranges] = {}
        self._received: set[int] = set()
        self._epoch, self._high, self._lows = 0, 0, deque([1] * _REPEATS, maxlen=_REPEATS)
        self._has_news = False
        self.heard_s = float("-inf")
        self.bytes_received = self.bytes_repeated = 0
        for row in ledger.parts(robot):
            self._parts[row.key] = _Part(row.total, row.ranges, self._open(row.key))

    def welcome(self, epoch: int, store_id: str) -> bytes:
        """Start a session; return the packet that names the parts of items that are here."""
        if epoch != self._epoch:
            self._epoch, self._high, self._received = epoch, 0, set()
            self._lows = deque([1] * _REPEATS, maxlen=_REPEATS)
            if self._ledger.note(f"store/{self._robot}") != store_id:
                self._start_again(store_id)
        parts, budget = [], MAX_RANGES
        for key, part in sorted(self._parts.items()):
            if part.ranges and (budget := budget - len(part.ranges) - 1) >= 0:
                parts.append([key, part.total, part.ranges])
        return pack(Kind.WELCOME, epoch, parts)

    def receive(self, fields: list[Any]) -> None:
        """Take a packet ``DATA``; one of an earlier session is ignored.

        Raises
        ------
        CodecError
            If its number is none of this session.
        OSError
            If the disk is full; the packet then counts as lost.
        """
        epoch, seq, key, total, offset, data = fields
        if epoch != self._epoch or not (0 <= offset <= offset + len(data) <= total <= _MAX_BYTES):
            return
        if not (0 < seq <= self._high + _MAX_AHEAD and key >= 0):
            raise CodecError(f"packet number {seq} of item {key}: the last number is {self._high}")
        self._take(key, total, offset, data)  # first: a packet that cannot be stored counts as lost
        self._has_news = True
        self._received.add(seq)
        self._high = max(self._high, seq)
        self.bytes_received += len(data)

    def _take(self, key: int, total: int, offset: int, data: bytes) -> None:
        """Store the bytes of a packet."""
        if key in self._known:
            self.bytes_repeated += len(data)
            self._report(key)
        elif total <= CHUNK_BYTES:
            self._complete(key, data)
        elif self._arrivals.holds(key):
            self.bytes_repeated += len(data)
            self._want_record(key)
        else:
            self._write(key, total, offset, data)

    def flush(self) -> None:
        """Store the complete items, note the others, and report both."""
        with self._lock:
            changed = [PartRow(k, p.total, p.ranges) for k in self._changed if (p := self._parts.get(k))]
            if changed:
                self._ledger.set_parts(self._robot, changed)
            self._changed.clear()
        done = self._arrivals.store()
        with self._lock:
            for key in done:
                self._remove_part(key)
                self._report(key)
            for key in self._arrivals.take_void():
                self._remove_part(key)

    def acknowledgement(self) -> bytes | None:
        """Return the packet ``ACK``; None if there is nothing to report."""
        if not (self._has_news or self._done or self._wanted):
            return None
        low = self._lows[0]
        missing: Ranges = []
        for seq in range(low, self._high + 1):
            if seq not in self._received:
                add_range(missing, seq, seq + 1)
        if len(missing) > MAX_RANGES:  # the numbers after them are reported by the next one
            low = missing[-MAX_RANGES][0]
            missing = missing[-MAX_RANGES:]
        done = [self._done.popleft() for _ in range(min(len(self._done), _MAX_DONE))]
        self._done.extend((key, repeats - 1) for key, repeats in done if repeats > 1)
        wanted = [[key, ranges] for key, ranges in list(self._wanted.items())[:_MAX_WANTED]]
        self._wanted.clear()
        self._has_news = False
        packet = pack(Kind.ACK, self._epoch, low, self._high, missing, [key for key, _ in done], wanted)
        self._lows.append(self._high + 1)
        self._received = {seq for seq in self._received if seq >= self._lows[0]}
        return packet

    def missing_bytes(self, key: int, total: int) -> int:
        """Return how many bytes of an item are not here."""
        part = self._parts.get(key)
        return total - (0 if part is None else sum(b - a for a, b in part.ranges))

    def close(self) -> None:
        """Note the received intervals and close the files."""
        try:
            self.flush()
        except StorageError as error:
            logger.warning("what %s sent is not stored, and is sent again: %s", self._robot, error)
        for part in self._parts.values():
            os.close(part.descriptor)

    def _complete(self, key: int, content: bytes) -> None:
        try:
            self._arrivals.add(key, content)
        except CdffError as error:
            logger.warning("an item of %s is not readable, and is sent again: %s", self._robot, error)
            self._remove_part(key)

    def _write(self, key: int, total: int, offset: int, data: bytes) -> None:
        part = self._parts.get(key)
        if part is not None and part.total != total:
            self._remove_part(key)
            part = None
        if part is None:
            part = self._parts[key] = _Part(total, [], self._open(key))
            self._want_record(key)
        before = sum(b - a for a, b in part.ranges)
        os.pwrite(part.descriptor, data, offset)
        add_range(part.ranges, offset, offset + len(data))
        added = sum(b - a for a, b in part.ranges) - before
        self.bytes_repeated += len(data) - added
        self._changed.add(key)
        missing = missing_ranges(part.ranges, total)
        if not missing:
            self._complete(key, os.pread(part.descriptor, total, 0))
        elif not added:
            self._wanted[key] = missing[:MAX_RANGES]

    def _want_record(self, key: int) -> None:
        """Ask for the record of a payload if it is not here."""
        if self._arrivals.lacks_record(key):
            _, ordinal = item_of(key)
            self._wanted[Item.RECORD.key(ordinal)] = [(0, 1)]

    def _report(self, key: int) -> None:
        self._known[key] = None
        if len(self._known) > _REMEMBERED:
            del self._known[next(iter(self._known))]
        if all(key != waiting for waiting, _ in self._done):
            self._done.append((key, _REPEATS))

    def _start_again(self, store_id: str) -> None:
        """Discard the incomplete items: the keys belong to another store now."""
        for key in list(self._parts):
            self._remove_part(key)
        self._known.clear()
        self._ledger.clear(self._robot)
        self._arrivals.clear()
        self._ledger.set_note(f"store/{self._robot}", store_id)

    def _remove_part(self, key: int) -> None:
        part = self._parts.pop(key, None)
        if part is not None:
            os.close(part.descriptor)
            (self._folder / str(key)).unlink(missing_ok=True)
            self._ledger.remove_parts(self._robot, [key])

    def _open(self, key: int) -> int:
        return os.open(self._folder / str(key), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
