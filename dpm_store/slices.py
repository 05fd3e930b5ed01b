# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the spatial index names, in slices of the end of capture and in the order of a query.

A page holds some hundred products of a region that may hold a million. The index is asked for a short slice at the
query's end of time first; its length then follows from how many it held, so that about as many are looked at as are
wanted, however many there are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sqlalchemy import Connection

from cdff_common.clock import NS_PER_S
from dpm_store import sqlite
from dpm_store.records import Order, Query, read_cursor

#: The first slice is this part of the time asked for.
_FIRST = 64
#: By how much a slice may be longer than the one before.
_GROWTH = 16
#: A slice that names more than so many times the products wanted is made shorter.
_TOO_MANY = 8


@dataclass(frozen=True, slots=True)
class Slice:
    """Candidates whose capture ended after ``after_ns`` and at or before ``until_ns``; some lie just outside."""

    after_ns: int
    until_ns: int
    ordinals: list[int]


def slices(
    connection: Connection, query: Query, boxes: Sequence[sqlite.IndexBox], epoch_ns: int, wanted: int
) -> Iterator[Slice]:
    """Candidates in any of the boxes, slice after slice in the order newest or oldest.

    Parameters
    ----------
    query : Query
        Its times and its cursor bound what is looked at.
    boxes : sequence of IndexBox
    epoch_ns : int
        Time that index times are counted from.
    wanted : int
        About how many candidates are good in one slice.
    """
    low, high = sqlite.ends_of_capture(connection)
    newest_first = query.order is not Order.OLDEST
    if query.t0_ns is not None:
        low = max(low, query.t0_ns)
    if query.cursor is not None:
        place = read_cursor(query.cursor, query.order).t1_ns
        low, high = (low, min(high, place)) if newest_first else (max(low, place), high)
    look = _Look(connection, query, boxes, epoch_ns, wanted)
    body_end = high if query.t1_ns is None else min(high, query.t1_ns)
    tail = [(max(body_end, low - 1), high)] if body_end < high else []  # ends after the time asked for, began within
    for after, until in tail if newest_first else ():
        yield look.at(after, until)
    yield from look.backwards(low - 1, body_end) if newest_first else look.forwards(low - 1, body_end)
    for after, until in () if newest_first else tail:
        yield look.at(after, until)


class _Look:
    def __init__(
        self, connection: Connection, query: Query, boxes: Sequence[sqlite.IndexBox], epoch_ns: int, wanted: int
    ) -> None:
        self._connection = connection
        self._boxes = boxes
        self._epoch_ns = epoch_ns
        self._wanted = wanted
        self._began_s = None if query.t1_ns is None else (query.t1_ns - epoch_ns) / NS_PER_S
        self._indexes = sqlite.INDEXES[:1] if query.as_of_ns is None else sqlite.INDEXES

    def at(self, after_ns: int, until_ns: int, most: int | None = None) -> Slice:
        """Candidates of one slice: all of them, or some more than ``most``."""
        ends_s = ((after_ns - self._epoch_ns) / NS_PER_S, (until_ns - self._epoch_ns) / NS_PER_S)
        found: list[int] = []
        for index in self._indexes:
            found += sqlite.candidates_between(self._connection, index, self._boxes, ends_s, self._began_s, most)
        return Slice(after_ns, until_ns, found)

    def backwards(self, low: int, high: int) -> Iterator[Slice]:
        """From the newest on."""
        width, until = self._first(low, high), high
        while until > low:
            found = self.at(max(low, until - width), until, most := self._most(width))
            if most is not None and len(found.ordinals) > most:
                width //= _GROWTH
                continue
            yield found
            until, width = found.after_ns, width * self._growth(found)

    def forwards(self, low: int, high: int) -> Iterator[Slice]:
        """From the oldest on."""
        width, after = self._first(low, high), low
        while after < high:
            found = self.at(after, min(high, after + width), most := self._most(width))
            if most is not None and len(found.ordinals) > most:
                width //= _GROWTH
                continue
            yield found
            after, width = found.until_ns, width * self._growth(found)

    @staticmethod
    def _first(low: int, high: int) -> int:
        return max(1, (high - low) // _FIRST)

    def _most(self, width: int) -> int | None:
        """How many candidates a slice may name before it is made shorter; None where it is short enough."""
        return _TOO_MANY * self._wanted if width >= NS_PER_S else None

    def _growth(self, found: Slice) -> int:
        count = len(found.ordinals)
        return _GROWTH if not count else max(1, min(2 * _GROWTH, 5 * self._wanted // (4 * count)))
