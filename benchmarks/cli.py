# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure the time of ``cdff --help`` (goal: 0.3 s), compared with an empty interpreter.

python benchmarks/cli.py [--out FILE] [--rounds N]
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import subprocess
import sys
import time
from pathlib import Path

from _report import write_report


def seconds(command: list[str], rounds: int) -> dict[str, float]:
    """Return wall and CPU seconds of a command, median and minimum over ``rounds`` runs after a warm-up."""
    wall, cpu = [], []
    for _ in range(rounds + 1):
        before, started = os.times(), time.perf_counter()
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        wall.append(time.perf_counter() - started)
        after = os.times()
        cpu.append(
            after.children_user + after.children_system - before.children_user - before.children_system
        )
    return {
        "wall_s_median": round(statistics.median(wall[1:]), 4),
        "wall_s_min": round(min(wall[1:]), 4),
        "cpu_s_median": round(statistics.median(cpu[1:]), 4),
    }


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=20)
    args = parser.parse_args()
    cdff = str(Path(sys.executable).parent / "cdff")
    report = {
        "benchmark": "cli",
        "python": platform.python_version(),
        "cores": os.cpu_count(),
        "rounds": args.rounds,
        "interpreter": seconds([sys.executable, "-c", "pass"], args.rounds),
        "cdff --help": seconds([cdff, "--help"], args.rounds),
        "cdff --version": seconds([cdff, "--version"], args.rounds),
        "cdff dfn list": seconds([cdff, "dfn", "list"], args.rounds),
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()
