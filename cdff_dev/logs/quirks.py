# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Deviations of real InFuse logs from their format: accepted, and each reported once."""

from __future__ import annotations

import logging
from collections import Counter
from typing import Any

_log = logging.getLogger(__name__)

#: A count of microseconds since 1970 above this (year 5138) is one of nanoseconds.
NANOSECONDS_ABOVE = 100_000_000_000_000_000


class Quirks:
    """Counts quirks by text; the first of each is logged as a warning."""

    def __init__(self, log_name: str) -> None:
        self._log_name = log_name
        self.counts: Counter[str] = Counter()

    def tell(self, text: str) -> None:
        """Count a quirk."""
        if not self.counts[text]:
            _log.warning("%s: %s", self._log_name, text)
        self.counts[text] += 1


def stamp_ns(microseconds: int, stream: str, quirks: Quirks) -> int:
    """Return the stamp of a ``.meta`` time; nanoseconds in the field of microseconds are recognised."""
    if microseconds > NANOSECONDS_ABOVE:
        quirks.tell(f"{stream}.meta: nanoseconds in the place of microseconds")
        return microseconds // 1000 * 1000
    return microseconds * 1000


def with_microseconds(sample: Any, where: str, quirks: Quirks) -> Any:
    """Return a copy of a plain sample whose ``microseconds`` are microseconds."""
    if not isinstance(sample, dict):
        return sample
    fixed = {}
    for key, value in sample.items():
        if key == "microseconds" and type(value) is int and value > NANOSECONDS_ABOVE:
            quirks.tell(f"{where}.microseconds: nanoseconds in the place of microseconds")
            fixed[key] = value // 1000
        elif isinstance(value, dict):
            fixed[key] = with_microseconds(value, f"{where}.{key}", quirks)
        else:
            fixed[key] = value
    return fixed
