# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure the cost of a call, and write the report of a benchmark."""

from __future__ import annotations

import json
import statistics
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any


def measure(call: Callable[[], object], rounds: int) -> dict[str, float]:
    """Return median and minimum CPU seconds of a call, and the peak memory that it allocates, MB.

    The first call is a warm-up. The minimum is least affected by other load on the machine.
    """
    call()
    times = []
    for _ in range(rounds):
        started = time.process_time()
        call()
        times.append(time.process_time() - started)
    tracemalloc.start()
    call()
    memory_mb = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    return {
        "cpu_s": round(statistics.median(times), 5),
        "least_cpu_s": round(min(times), 5),
        "memory_mb": round(memory_mb, 2),
    }


def write_report(report: dict[str, Any], out: Path | None) -> None:
    """Print a report as JSON, and write it to ``out`` if given."""
    text = json.dumps(report, indent=1)
    print(text)
    if out is not None:
        out.write_text(text + "\n", encoding="utf-8")
