# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Open recordings with randomly damaged bytes in each format of logs.

A reader passes if it reads the recording in whole or in part, or raises an error of the project that names
the file, with at most 1 GB of memory. Crashes, other exceptions and 60 s of CPU time are faults.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from evaluation.runs.log_mutations import run
from evaluation.scenes.log_files import POCOLOG, SIMULATED

#: Number of damaged copies of each format.
OPTIONS = {"count": 100_000, "seed": 0}
#: Formats; each takes some minutes.
PARTS = (*SIMULATED, POCOLOG)
_OUTCOMES = ("read", "read without the damaged part", "read up to an error", "refused")


def evaluate(
    data: Path,
    progress: Callable[[str], None],
    parts: Sequence[str] = PARTS,
    count: int = OPTIONS["count"],
    seed: int = OPTIONS["seed"],
) -> dict[str, Any]:
    """Return outcomes, faults and memory by format; the copies have the numbers from ``seed * 10**6``."""
    figures: dict[str, Any] = {}
    for name in parts:
        progress(f"log_mutations: {name}")
        first = seed * 10**6
        figures[name] = {"count": count, "seed": seed, **run(name, first, first + count, data)}
    return figures


def table(figures: Mapping[str, Any]) -> str:
    """Return the table of outcomes and the list of faults."""
    lines = [
        f"| format | copies | {' | '.join(_OUTCOMES)} | faults | memory |",
        "|---" * (len(_OUTCOMES) + 4) + "|",
    ]
    faults = []
    for name, result in figures.items():
        counts = " | ".join(str(result["outcomes"].get(outcome, 0)) for outcome in _OUTCOMES)
        lines.append(
            f"| {name} | {result['count']} | {counts} | {len(result['faults'])} | {result['memory_mb']:.0f} MB |"
        )
        faults += [f"- {name}, copy {f['number']}: `{f['reason']}`" for f in result["faults"][:5]]
    return "\n".join(
        [*lines, "", *(["The first faults of each format:", "", *faults] if faults else ["No faults."])]
    )
