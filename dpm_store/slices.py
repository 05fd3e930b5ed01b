# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the spatial index names, in slices of the end of capture and in the order of a query.

A page holds some hundred products of a region that may hold a million. The index is asked for a short slice at the
query's end of time first; its length then follows from how many it held, so that about as many are looked at as are
wanted, however many there are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter

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
    """Candidates whose capture ended after ``after_ns`` and at or before ``until_ns``; some lie just outside.

    Attributes
    ----------
    found : list of int and float
        Ordinal and end of capture as the index counts it, of each.
    """

    after_ns: int
    until_ns: int
    found: list[tuple[int, float]]

    @property
    def ordinals(self) -> list[int]:
        """In order, each once."""
        return sorted({ordinal for ordinal, _ in self.found})


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
    body_end = max(body_end, low - 1)
    if newest_first:
        yield from look.backwards(low - 1, body_end, high)
        return
    yield from look.forwards(low - 1, body_end)
    if body_end < high:  # ends after the time asked for, began within
        yield look.at(body_end, high)


def portions(whole: Slice, wanted: int, epoch_ns: int, *, newest_first: bool) -> Iterator[Slice]:
    """The slice as shorter ones with about as many candidates as wanted: their rows are what takes longest to read.

    The index tells when each ended to about a second; those near a cut are looked at on both sides of it.
    """
    left = sorted(whole.found, key=itemgetter(1), reverse=newest_first)
    after, until = whole.after_ns, whole.until_ns
    while len(left) > wanted:
        bounds_ns = [_bounds_ns(counted, epoch_ns) for _, counted in left[wanted // 2 : wanted + 1]]
        cut = bounds_ns[-1][1] if newest_first else bounds_ns[-1][0] - 1
        cut = min(max(cut, after), until)
        sure = sum(first > cut if newest_first else last <= cut for first, last in bounds_ns[:-1])
        if not sure:  # so many ended at nearly one time
            break
        yield Slice(cut, until, left[:wanted]) if newest_first else Slice(after, cut, left[:wanted])
        left = left[wanted // 2 + sure :]
        after, until = (after, cut) if newest_first else (cut, until)
    yield Slice(after, until, left)


def _bounds_ns(counted: float, epoch_ns: int) -> tuple[int, int]:
    first_s, last_s = sqlite.ended_s(counted)
    return epoch_ns + math.floor(first_s * NS_PER_S), epoch_ns + math.ceil(last_s * NS_PER_S)


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
        found: list[tuple[int, float]] = []
        for index in self._indexes:
            found += sqlite.candidates_between(self._connection, index, self._boxes, ends_s, self._began_s, most)
        return Slice(after_ns, until_ns, found)

    def backwards(self, low: int, end: int, high: int) -> Iterator[Slice]:
        """From the newest on; what began within the time asked for and ended after ``end`` is in the first slice."""
        width, until, upper = self._first(low, end), end, high
        while upper > low:
            found = self.at(max(low, until - width), upper, most := self._most(width))
            if most is not None and len(found.found) > most:
                if upper > until:
                    yield self.at(until, upper)
                    upper = until
                else:
                    width //= _GROWTH
                continue
            yield found
            until, width = found.after_ns, width * self._growth(found)
            upper = until

    def forwards(self, low: int, high: int) -> Iterator[Slice]:
        """From the oldest on."""
        width, after = self._first(low, high), low
        while after < high:
            found = self.at(after, min(high, after + width), most := self._most(width))
            if most is not None and len(found.found) > most:
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
        count = len(found.found)
        return _GROWTH if not count else max(1, min(4 * _GROWTH, 3 * self._wanted // (2 * count)))
