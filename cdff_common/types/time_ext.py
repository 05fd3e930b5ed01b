# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of ``Time``."""

from __future__ import annotations

from datetime import datetime

from cdff_common import types
from cdff_common.clock import MAX_STAMP_NS, NS_PER_S, to_datetime
from cdff_common.errors import InputError
from cdff_common.types.message import Message


class TimeExt(Message):
    """Conversion between the microseconds of messages and ``stamp_ns``."""

    __slots__ = ()
    microseconds: int
    usec_per_sec: int

    @classmethod
    def from_ns(cls, ns: int) -> types.Time:
        """Return the time of ``ns`` nanoseconds since the UNIX epoch, a multiple of 1000.

        Raises
        ------
        InputError
            If it is not representable in microseconds, or does not fit 64 bits.
        """
        if isinstance(ns, bool) or int(ns) != ns or ns % 1000:
            raise InputError(f"stamp {ns} ns: expected a multiple of 1000 ns (messages contain microseconds)")
        if abs(int(ns)) > MAX_STAMP_NS:
            raise InputError(f"stamp {ns} ns: expected at most {MAX_STAMP_NS} ns, which fits 64 bits")
        return types.Time(int(ns) // 1000)

    @property
    def ns(self) -> int:
        """Nanoseconds since the UNIX epoch, a multiple of 1000.

        Raises
        ------
        InputError
            If ``usec_per_sec`` is not positive, or the nanoseconds do not fit 64 bits.
        """
        if self.usec_per_sec <= 0:
            raise InputError(f"Time.usec_per_sec={self.usec_per_sec}: expected 1000000")
        ns = self.microseconds * NS_PER_S // self.usec_per_sec // 1000 * 1000
        if abs(ns) > MAX_STAMP_NS:
            raise InputError(f"Time.microseconds={self.microseconds}: its nanoseconds do not fit 64 bits")
        return ns

    def to_datetime(self) -> datetime:
        """Return the time in UTC, without leap seconds."""
        return to_datetime(self.ns)

    @property
    def stamp_ns(self) -> int:
        """Same as ``ns``."""
        return self.ns
