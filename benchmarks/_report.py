# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What benchmarks have in common: timing a call, and giving out the report."""

from __future__ import annotations

import json
import statistics
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any


def measured(call: Callable[[], object], rounds: int) -> dict[str, float]:
    """CPU seconds of a call after one to warm up, median and least (other load only adds), and megabytes it holds."""
    call()
    times = []
    for _ in range(rounds):
        began = time.process_time()
        call()
        times.append(time.process_time() - began)
    tracemalloc.start()
    call()
    memory_mb = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    return {
        "cpu_s": round(statistics.median(times), 5), "least_cpu_s": round(min(times), 5),
        "memory_mb": round(memory_mb, 2),
    }  # fmt: skip


def give_out(report: dict[str, Any], out: Path | None) -> None:
    """Print a report as JSON, and write it to ``out`` where that is named."""
    text = json.dumps(report, indent=1)
    print(text)
    if out is not None:
        out.write_text(text + "\n", encoding="utf-8")
