# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Quirks: deviations of InFuse logs from their format, which are accepted and reported once each."""

from __future__ import annotations

import logging
from collections import Counter
from typing import Any

_log = logging.getLogger(__name__)

#: A time in microseconds since 1970 that is larger than this (year 5138) is in nanoseconds.
NANOSECONDS_ABOVE = 100_000_000_000_000_000


class Quirks:
    """Counter of quirks by description; the first of each is logged as a warning with its file."""

    def __init__(self) -> None:
        self.file_name = "log"
        self.counts: Counter[str] = Counter()

    def record(self, text: str) -> None:
        """Count a quirk, and log it with ``file_name`` if it is the first with this description."""
        if not self.counts[text]:
            _log.warning("%s: %s", self.file_name, text)
        self.counts[text] += 1


def stamp_ns(microseconds: int, stream: str, quirks: Quirks) -> int:
    """Return the stamp of a time in ``.meta``, which may be in nanoseconds instead of microseconds."""
    if microseconds > NANOSECONDS_ABOVE:
        quirks.record(f"{stream}.meta: nanoseconds in the place of microseconds")
        return microseconds // 1000 * 1000
    return microseconds * 1000


def with_microseconds(sample: Any, where: str, quirks: Quirks) -> Any:
    """Return a copy of a sample in dictionary form whose fields ``microseconds`` are in microseconds."""
    if not isinstance(sample, dict):
        return sample
    corrected = {}
    for key, value in sample.items():
        if key == "microseconds" and type(value) is int and value > NANOSECONDS_ABOVE:
            quirks.record(f"{where}.microseconds: nanoseconds in the place of microseconds")
            corrected[key] = value // 1000
        elif isinstance(value, dict):
            corrected[key] = with_microseconds(value, f"{where}.{key}", quirks)
        else:
            corrected[key] = value
    return corrected
