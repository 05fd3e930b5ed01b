# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Repeated warnings are suppressed and counted."""

from __future__ import annotations

import logging

from cdff_common.log import RepetitionFilter


def record(template: str, *arguments: object, level: int = logging.WARNING) -> logging.LogRecord:
    return logging.LogRecord("bus", level, "", 0, template, arguments, None)


def test_a_flood_of_warnings_is_limited_and_counted() -> None:
    now_s = 0.0
    filter_ = RepetitionFilter(limit=3, period_s=60.0, now_s=lambda: now_s)
    passed = [filter_.filter(record("malformed message on %s", i)) for i in range(1000)]
    assert passed == [True] * 3 + [False] * 997
    assert filter_.filter(record("another message")), "each template has its own limit"
    assert all(filter_.filter(record("sensor mode", level=logging.INFO)) for _ in range(100))
    now_s = 61.0
    following = record("malformed message on %s", "key")
    assert filter_.filter(following)
    assert following.__dict__["suppressed"] == 997
