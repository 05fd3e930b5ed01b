# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Candidates of the spatial index, in slices of the end of capture and in the order of a query.

A page has some hundred products of a region that may have a million. A short slice at the query's end of time
is read first. The number of its candidates determines the length of the next slice, so that the number of
rows that are read depends on the page and not on the store. If the database is another process, the whole
interval is tried first, because a round trip takes longer than the candidates that are read in vain.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter

from sqlalchemy import Connection, func, select

from cdff_common.clock import NS_PER_S
from dpm_store.engine import schema
from dpm_store.engine.database import dialect_of
from dpm_store.engine.dialect import Dialect, IndexBox
from dpm_store.products.records import Order, Query, read_cursor

#: The first slice is this fraction of the interval.
_FIRST = 64
#: Largest ratio of the lengths of successive slices.
_GROWTH = 16
#: A slice with more than this many times the required candidates is shortened.
_TOO_MANY = 8
_t1 = schema.products.c.t1_ns
#: Earliest and latest end of capture of the store.
ENDS = select(select(func.min(_t1)).scalar_subquery(), select(func.max(_t1)).scalar_subquery())


@dataclass(frozen=True, slots=True)
class Slice:
    """Candidates with an end of capture in (``after_ns``, ``until_ns``]; a few lie slightly outside.

    Attributes
    ----------
    entries : list of int and float
        Ordinals and end keys (see ``Dialect.end_bounds_s``).
    """

    after_ns: int
    until_ns: int
    entries: list[tuple[int, float]]

    @property
    def ordinals(self) -> list[int]:
        """Ordinals in order, each once."""
        return sorted({ordinal for ordinal, _ in self.entries})


def slices(
    connection: Connection, query: Query, boxes: Sequence[IndexBox], epoch_ns: int, count: int
) -> Iterator[Slice]:
    """Return the candidates in any of the boxes, slice by slice in the order newest or oldest.

    Parameters
    ----------
    query : Query
        Its times and its cursor bound the interval.
    boxes : sequence of IndexBox
    epoch_ns : int
        Origin of the times in the index.
    count : int
        Approximate number of candidates per slice.
    """
    ((low, high),) = dialect_of(connection).fetch(connection, ENDS)
    newest_first = query.order is not Order.OLDEST
    if query.t0_ns is not None:
        low = max(low, query.t0_ns)
    if query.cursor is not None:
        last = read_cursor(query.cursor, query.order).t1_ns
        low, high = (low, min(high, last)) if newest_first else (max(low, last), high)
    reader = _SliceReader(connection, query, boxes, epoch_ns, count)
    end = max(high if query.t1_ns is None else min(high, query.t1_ns), low - 1)
    if newest_first:
        yield from reader.backwards(low - 1, end, high)
        return
    yield from reader.forwards(low - 1, end)
    if end < high:  # captures that end after the interval and start in it
        yield reader.at(end, high)


def portions(
    candidates: Slice, count: int, epoch_ns: int, dialect: Dialect, *, newest_first: bool
) -> Iterator[Slice]:
    """Yield parts of a slice with about ``count`` candidates each, since reading rows takes the most time.

    The index gives the end of capture to about a second; candidates near a cut are in both parts.
    """
    remaining = sorted(candidates.entries, key=itemgetter(1), reverse=newest_first)
    after, until = candidates.after_ns, candidates.until_ns
    while len(remaining) > count:
        bounds_ns = [_bounds_ns(key, epoch_ns, dialect) for _, key in remaining[count // 2 : count + 1]]
        boundary_ns = bounds_ns[-1][1] if newest_first else bounds_ns[-1][0] - 1
        boundary_ns = min(max(boundary_ns, after), until)
        certain_count = sum(
            first > boundary_ns if newest_first else last <= boundary_ns for first, last in bounds_ns[:-1]
        )
        if not certain_count:  # too many ended at nearly the same time
            break
        yield (
            Slice(boundary_ns, until, remaining[:count])
            if newest_first
            else Slice(after, boundary_ns, remaining[:count])
        )
        remaining = remaining[count // 2 + certain_count :]
        after, until = (after, boundary_ns) if newest_first else (boundary_ns, until)
    yield Slice(after, until, remaining)


def _bounds_ns(key: float, epoch_ns: int, dialect: Dialect) -> tuple[int, int]:
    """Return times that enclose the end time stored in the index with limited precision, nanoseconds."""
    first_s, last_s = dialect.end_bounds_s(key)
    return epoch_ns + math.floor(first_s * NS_PER_S), epoch_ns + math.ceil(last_s * NS_PER_S)


class _SliceReader:
    def __init__(
        self,
        connection: Connection,
        query: Query,
        boxes: Sequence[IndexBox],
        epoch_ns: int,
        count: int,
    ) -> None:
        self._connection = connection
        self._boxes = boxes
        self._epoch_ns = epoch_ns
        self._count = count
        self._started_before_s = None if query.t1_ns is None else (query.t1_ns - epoch_ns) / NS_PER_S
        self._dialect = dialect = dialect_of(connection)
        self._indexes = dialect.INDEXES[:1] if query.as_of_ns is None else dialect.INDEXES

    def at(self, after_ns: int, until_ns: int, limit: int | None = None) -> Slice:
        """Return the candidates of one slice: all of them, or more than ``limit``."""
        ends_s = ((after_ns - self._epoch_ns) / NS_PER_S, (until_ns - self._epoch_ns) / NS_PER_S)
        entries: list[tuple[int, float]] = []
        for index in self._indexes:
            entries += self._dialect.candidates_between(
                self._connection, index, self._boxes, ends_s, self._started_before_s, limit
            )
        return Slice(after_ns, until_ns, entries)

    def backwards(self, low: int, end: int, high: int) -> Iterator[Slice]:
        """Return slices from the newest; the first includes captures that end after ``end``."""
        width, until, upper = self._first(low, end), end, high
        while upper > low:
            candidates = self.at(max(low, until - width), upper, limit := self._limit(width))
            if limit is not None and len(candidates.entries) > limit:
                if upper > until:
                    yield self.at(until, upper)
                    upper = until
                else:
                    width = self._shorter(width, end - low)
                continue
            yield candidates
            until, width = candidates.after_ns, width * self._growth(candidates)
            upper = until

    def forwards(self, low: int, high: int) -> Iterator[Slice]:
        """Return slices from the oldest."""
        width, after = self._first(low, high), low
        while after < high:
            candidates = self.at(after, min(high, after + width), limit := self._limit(width))
            if limit is not None and len(candidates.entries) > limit:
                width = self._shorter(width, high - low)
                continue
            yield candidates
            after, width = candidates.until_ns, width * self._growth(candidates)

    def _first(self, low: int, high: int) -> int:
        return max(1, (high - low) // (1 if self._dialect.is_shared else _FIRST))

    @staticmethod
    def _shorter(width: int, whole: int) -> int:
        """Return the length of a slice after one with too many candidates."""
        return width // (_FIRST if width >= whole else _GROWTH)

    def _limit(self, width: int) -> int | None:
        """Return the number of candidates above which a slice is shortened; None for a short slice."""
        return _TOO_MANY * self._count if width >= NS_PER_S else None

    def _growth(self, candidates: Slice) -> int:
        count = len(candidates.entries)
        return _GROWTH if not count else max(1, min(4 * _GROWTH, 3 * self._count // (2 * count)))
