# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transfer of items from a robot: in order of priority, from the offsets that the ground lacks.

Every packet has a sequence number. The ground acknowledges numbers, and a packet whose followers were
acknowledged is sent again (selective repeat). An item is complete only when the ground has stored it, which
it reports by the key of the item.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from dpm_store.exchange.ledger import Ranges
from services.contact.packets import CHUNK_BYTES, FRAME_BYTES, Kind, add_range, missing_ranges, pack

#: Packets that must follow a missing one before it counts as lost.
_REORDERED = 3
#: Time without a report that a completely sent item is stored, after which one of its packets is sent again.
_PROBE_S = 2.0
#: Packets without an acknowledgement in addition to those of a round trip.
_SPARE_PACKETS = 32


class _Chunk(NamedTuple):
    key: int
    offset: int
    length: int


class _InFlight(NamedTuple):
    chunk: _Chunk
    sent_s: float


@dataclass(slots=True)
class _Transfer:
    """State of an item: the intervals to send, and when a packet of it was last sent or acknowledged."""

    priority: int
    total: int
    todo: Ranges = field(default_factory=list)
    changed_s: float = 0.0


class Sender:
    """Items to send, and packets without an acknowledgement.

    Parameters
    ----------
    read : callable
        Returns bytes of an item: key, offset, length.
    size : callable
        Returns the size of an item; None if it no longer exists.
    on_void : callable
        Called with the key of an item that no longer exists.

    Attributes
    ----------
    packets, bytes_sent, bytes_resent : int
        Packets and item bytes since the start, and those of the bytes that were sent before.
    """

    def __init__(
        self,
        read: Callable[[int, int, int], bytes],
        size: Callable[[int], int | None],
        on_void: Callable[[int], None],
    ) -> None:
        self._read, self._size, self._on_void = read, size, on_void
        self._queue: list[tuple[int, int]] = []  # (priority, key), a heap
        self._transfers: dict[int, _Transfer | None] = {}  # None: not begun
        self._priorities: dict[int, int] = {}
        self._lost: deque[_Chunk] = deque()
        self._in_flight: dict[int, _InFlight] = {}
        self._parts: dict[int, Ranges] = {}
        self._highest: dict[int, int] = {}  # end of the bytes of an item that were sent
        # bytes that were sent in this session before the ground reported its intervals; then None
        self._in_session: dict[int, Ranges] | None = None
        self.epoch, self._seq = 0, 0
        self.packets = self.bytes_sent = self.bytes_resent = 0

    def add(self, key: int, priority: int) -> None:
        """Add an item, or send it earlier than planned."""
        known = self._priorities.get(key)
        if known is None or priority < known:
            self._priorities[key] = priority
            self._transfers.setdefault(key, None)
            heapq.heappush(self._queue, (priority, key))

    def remove(self, key: int) -> None:
        """Remove an item that the ground has stored."""
        for table in (self._transfers, self._priorities, self._highest, self._parts):
            table.pop(key, None)

    def __contains__(self, key: int) -> bool:
        return key in self._priorities

    def __len__(self) -> int:
        return len(self._priorities)

    def begin(self, epoch: int) -> None:
        """Start a session; until ``resume`` the bytes are sent that were not sent in an earlier one."""
        self.epoch, self._seq = epoch, 0
        self._in_flight.clear()
        self._lost.clear()
        self._in_session = {}

    def resume(self, parts: Iterable[tuple[int, int, Ranges]]) -> None:
        """Send the missing bytes; the ground has parts of items, each a key, a size and intervals."""
        sent, self._in_session = self._in_session or {}, None
        self._parts = {key: [(a, b) for a, b in ranges] for key, _, ranges in parts}
        for key, transfer in self._transfers.items():
            if transfer is not None:
                present = self._parts.pop(key, [])
                for first, end in sent.get(key, []):
                    add_range(present, first, end)
                is_in_flight = key in sent
                transfer.todo = missing_ranges(present, transfer.total)
                if not transfer.todo and not is_in_flight:
                    transfer.todo = [self._probe(transfer.total)]
                heapq.heappush(self._queue, (self._priorities[key], key))

    def progress(self) -> dict[int, int]:
        """Return the end of the sent bytes of each item of several packets, by its key."""
        return {
            key: self._highest[key]
            for key, transfer in self._transfers.items()
            if transfer is not None and transfer.total > CHUNK_BYTES and key in self._highest
        }

    def expect(self, progress: Mapping[int, int]) -> None:
        """Continue after the bytes that an earlier process sent, until the ground reports its intervals."""
        self._parts = {key: [(0, end)] for key, end in progress.items()}

    @property
    def oldest_s(self) -> float:
        """Time at which the oldest packet without an acknowledgement was sent; infinity if there is none."""
        return next((entry.sent_s for entry in self._in_flight.values()), float("inf"))

    def next_packet(self, now_s: float) -> bytes | None:
        """Return the next packet; None if there is nothing to send."""
        while (chunk := self._next_chunk(now_s)) is not None:
            data = self._read(chunk.key, chunk.offset, chunk.length)
            transfer = self._transfers.get(chunk.key)
            if transfer is None:
                continue
            self._seq += 1
            self._in_flight[self._seq] = _InFlight(chunk, now_s)
            transfer.changed_s = now_s
            self._count(chunk)
            fields = (self.epoch, self._seq, chunk.key, transfer.total, chunk.offset, data)
            return pack(Kind.DATA, *fields)
        return None

    def acknowledge(self, low: int, high: int, missing: Ranges) -> None:
        """Apply an acknowledgement of the sequence numbers ``low … high``, except ``missing``."""
        for seq in [s for s in self._in_flight if low <= s <= high]:
            if not any(first <= seq < end for first, end in missing):
                del self._in_flight[seq]
            elif seq <= high - _REORDERED:
                self._lost.append(self._in_flight.pop(seq).chunk)

    def want(self, key: int, missing: Ranges) -> None:
        """Send intervals of an item again, which the ground lacks."""
        transfer = self._transfers.get(key)
        if transfer is not None and not transfer.todo and not self._is_in_flight(key):
            transfer.todo = [(max(a, 0), min(b, transfer.total)) for a, b in missing]
            heapq.heappush(self._queue, (self._priorities[key], key))

    def expire(self, now_s: float, timeout_s: float) -> None:
        """Send again packets without an acknowledgement, and one packet of items that are not reported."""
        for seq in [s for s, entry in self._in_flight.items() if now_s - entry.sent_s > timeout_s]:
            self._lost.append(self._in_flight.pop(seq).chunk)
        for key, transfer in self._transfers.items():
            if transfer is None or transfer.todo or now_s - transfer.changed_s < _PROBE_S + timeout_s:
                continue
            if not self._is_in_flight(key) and not any(chunk.key == key for chunk in self._lost):
                transfer.changed_s = now_s
                first, end = self._probe(transfer.total)
                self._lost.append(_Chunk(key, first, end - first))

    def is_limited(self, rate_bit_s: float, round_trip_s: float) -> bool:
        """Return whether more packets than fit in a round trip have no acknowledgement."""
        limit = rate_bit_s / 8.0 * round_trip_s / (CHUNK_BYTES + FRAME_BYTES) + _SPARE_PACKETS
        return len(self._in_flight) > limit

    def _is_in_flight(self, key: int) -> bool:
        return any(entry.chunk.key == key for entry in self._in_flight.values())

    def _next_chunk(self, now_s: float) -> _Chunk | None:
        while self._lost:
            chunk = self._lost.popleft()
            if self._transfers.get(chunk.key) is not None:
                return chunk
        while self._queue:
            priority, key = self._queue[0]
            transfer = self._transfer(key, priority, now_s) if self._priorities.get(key) == priority else None
            if transfer is None or not transfer.todo:
                heapq.heappop(self._queue)
                continue
            first, end = transfer.todo[0]
            length = min(CHUNK_BYTES, end - first)
            transfer.todo[0] = (first + length, end)
            if first + length >= end:
                transfer.todo.pop(0)
            return _Chunk(key, first, length)
        return None

    def _transfer(self, key: int, priority: int, now_s: float) -> _Transfer | None:
        """Return the state of an item, which begins now if it was not begun."""
        transfer = self._transfers.get(key)
        if transfer is None:
            total = self._size(key)
            if total is None:
                self.remove(key)
                self._on_void(key)
                return None
            todo = missing_ranges(self._parts.pop(key, []), total)
            if not todo:
                todo = [self._probe(total)]
            transfer = self._transfers[key] = _Transfer(priority, total, todo, now_s)
        return transfer

    @staticmethod
    def _probe(total: int) -> tuple[int, int]:
        """Return an interval of an item whose bytes the ground has: it then reports the item."""
        return (0, min(CHUNK_BYTES, total))

    def _count(self, chunk: _Chunk) -> None:
        if self._in_session is not None:
            add_range(self._in_session.setdefault(chunk.key, []), chunk.offset, chunk.offset + chunk.length)
        end, highest = chunk.offset + chunk.length, self._highest.get(chunk.key, 0)
        self.packets += 1
        self.bytes_sent += chunk.length
        self.bytes_resent += max(min(highest, end) - chunk.offset, 0)
        self._highest[chunk.key] = max(highest, end)
