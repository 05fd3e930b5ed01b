# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Resident memory of a process: freed memory is returned to the system, and a budget has an alarm."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from cdff_common.errors import ConfigurationError
from cdff_common.memory import release_memory
from services.alarms import Alarms, Severity

_KIND = "memory_over_budget"
#: Default of ``CDFF_MEMORY_MB``, megabytes.
DEFAULT_MB = 2000
#: Fraction of the budget below which the alarm ends.
_END = 0.9
#: Growth since the last release after which freed memory is released, megabytes.
_GROWTH_MB = 32.0


def memory_budget_mb() -> int:
    """Return the memory budget of one process, ``CDFF_MEMORY_MB``; raises ConfigurationError."""
    text = os.environ.get("CDFF_MEMORY_MB", str(DEFAULT_MB))
    if not text.isdecimal() or not int(text):
        raise ConfigurationError(f"CDFF_MEMORY_MB={text!r}: expected whole megabytes, at least 1")
    return int(text)


def resident_mb() -> float:
    """Return the resident memory of this process (Linux; 0 elsewhere)."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except FileNotFoundError:
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def memory_check(alarms: Alarms, source: str, budget_mb: int) -> Callable[[], None]:
    """Return a function that compares the memory of this process with its budget.

    The function begins the alarm if the memory exceeds ``budget_mb`` megabytes, otherwise it ends the alarm.
    If the memory has grown, the function first returns freed memory to the system.
    """
    released_mb = 0.0

    def check() -> None:
        nonlocal released_mb
        used_mb = resident_mb()
        if used_mb > released_mb + _GROWTH_MB:
            release_memory()
            released_mb = used_mb = resident_mb()
        if used_mb > budget_mb:
            problem = f"{used_mb:.0f} MB of memory are in use, expected at most {budget_mb} MB"
            remedy = "stop large requests, restart the service, or raise CDFF_MEMORY_MB"
            alarms.set(_KIND, source, Severity.WARNING, problem, remedy)
        elif used_mb < _END * budget_mb:
            alarms.clear(_KIND, source)

    return check
