# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measurement of the cost of a call, and output of the report of a benchmark."""

from __future__ import annotations

import json
import statistics
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any


def median_cpu_s(call: Callable[[], object], rounds: int) -> float:
    """Return the median CPU seconds of a call, after a warm-up call."""
    return statistics.median(_cpu_times_s(call, rounds))


def measure(call: Callable[[], object], rounds: int) -> dict[str, float]:
    """Return median and minimum CPU seconds of a call, and the peak memory that it allocates, MB.

    The first call is a warm-up. The minimum is least affected by other load on the machine.
    """
    times_s = _cpu_times_s(call, rounds)
    tracemalloc.start()
    call()
    memory_mb = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    return {
        "cpu_s": round(statistics.median(times_s), 5),
        "least_cpu_s": round(min(times_s), 5),
        "memory_mb": round(memory_mb, 2),
    }


def _cpu_times_s(call: Callable[[], object], rounds: int) -> list[float]:
    call()
    times_s = []
    for _ in range(rounds):
        start_s = time.process_time()
        call()
        times_s.append(time.process_time() - start_s)
    return times_s


def write_report(report: dict[str, Any], out: Path | None) -> None:
    """Print a report as JSON, and write it to ``out`` if given."""
    text = json.dumps(report, indent=1)
    print(text)
    if out is not None:
        out.write_text(text + "\n", encoding="utf-8")
