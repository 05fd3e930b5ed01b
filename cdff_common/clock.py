# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Clocks, which are injected everywhere, stamps, and the only access to the wall clock.

``stamp_ns`` is integer nanoseconds since the UNIX epoch, a multiple of 1000 because messages and logs contain
microseconds. Freshness, validity and retention use the mission clock; deadlines, leases and heartbeats use
``monotonic_s``.
"""

from __future__ import annotations

import re
import time
from datetime import UTC, datetime, timedelta
from typing import Protocol

from cdff_common.errors import InputError

NS_PER_S = 1_000_000_000
#: Latest stamp, in the year 2262: stamps are stored as 64-bit integers. The earliest is its negative.
MAX_STAMP_NS = (1 << 63) - 1


def monotonic_s() -> float:
    """Return the monotonic clock, seconds: for deadlines, leases and heartbeats only."""
    return time.monotonic()


def wall_ns() -> int:
    """Return the wall clock, nanoseconds since the UNIX epoch, rounded down to a microsecond."""
    return time.time_ns() // 1000 * 1000


class Clock(Protocol):
    """Source of mission time."""

    def now_ns(self) -> int:
        """Return mission time, nanoseconds, a multiple of 1000."""


class WallClock:
    """Wall clock as mission time, used when no log is played."""

    def now_ns(self) -> int:
        """Return mission time, nanoseconds, a multiple of 1000."""
        return wall_ns()


class ManualClock:
    """Clock that is set explicitly, for replay and tests."""

    def __init__(self, now_ns: int = 0) -> None:
        self._now_ns = now_ns

    def now_ns(self) -> int:
        """Return mission time, nanoseconds, a multiple of 1000."""
        return self._now_ns

    def set_ns(self, now_ns: int) -> None:
        """Set the clock to ``now_ns``."""
        self._now_ns = now_ns // 1000 * 1000


_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_DECIMAL = re.compile(r"-?\d{1,19}\Z")
_RFC3339 = re.compile(r"\d{4}-\d\d-\d\d[Tt]\d\d:\d\d:\d\d(\.\d+)?([Zz]|[+-]\d\d:\d\d)\Z")


def parse_stamp(text: str, name: str = "t") -> int:
    """Parse a decimal nanosecond string or an RFC 3339 time into ``stamp_ns``.

    Raises
    ------
    InputError
        If the text is neither, a time without a zone, or does not fit 64 bits of nanoseconds.
    """
    stamp_ns = int(text) if _DECIMAL.match(text) else _nanoseconds(text, name)
    if abs(stamp_ns) > MAX_STAMP_NS:
        raise InputError(
            f"{name}={text}: expected a stamp that fits 64 bits of nanoseconds (before the year 2262)"
        )
    if stamp_ns % 1000:
        raise InputError(f"{name}={text}: expected a multiple of 1000 ns (messages contain microseconds)")
    return stamp_ns


def parse_rfc3339(text: str, name: str = "t") -> int:
    """Parse a time exactly as RFC 3339 writes it into ``stamp_ns``; raises InputError for any other text."""
    if not _RFC3339.match(text):
        raise InputError(f"{name}={text[:80]!r}: expected a time of RFC 3339, e.g. 2026-11-20T12:00:00.5Z")
    return parse_stamp(text.upper(), name)


def _nanoseconds(text: str, name: str) -> int:
    """Return the nanoseconds of an RFC 3339 time; raises InputError."""
    try:
        moment = datetime.fromisoformat(text.replace("Z", "+00:00"))
    except ValueError as error:
        raise InputError(f"{name}={text!r}: expected nanoseconds as a decimal or an RFC 3339 time") from error
    if moment.tzinfo is None:
        raise InputError(f"{name}={text!r}: expected a time zone, e.g. 2026-11-20T12:00:00Z")
    return from_datetime(moment)


def to_datetime(stamp_ns: int) -> datetime:
    """Return ``stamp_ns`` as a time in UTC with microseconds."""
    return _EPOCH + timedelta(microseconds=stamp_ns // 1000)


def from_datetime(moment: datetime) -> int:
    """Return the ``stamp_ns`` of a time; raises InputError if it has no time zone."""
    if moment.tzinfo is None:
        raise InputError(f"{moment.isoformat()}: expected a time zone, such as datetime.now(UTC)")
    delta = moment - _EPOCH
    return ((delta.days * 86_400 + delta.seconds) * 1_000_000 + delta.microseconds) * 1000


def format_stamp(stamp_ns: int) -> str:
    """Return ``stamp_ns`` as RFC 3339 text with microseconds, in UTC."""
    seconds, rest_ns = divmod(stamp_ns, NS_PER_S)
    moment = datetime.fromtimestamp(seconds, UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{rest_ns // 1000:06d}Z"
