# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run a mission under random disturbances with ``python -m tests.chaos``, for 10 minutes and 2 hours.

``--seed`` selects the sequence of disturbances. What happens still depends on the speed of the machine.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cdff_common.errors import UnavailableError

ROOT = Path(__file__).resolve().parents[1]
#: Runs and their duration, minutes.
MINUTES = {"10_minutes": 10, "2_hours": 120}
PARTS = tuple(MINUTES)
OPTIONS = {"seed": 0}


def evaluate(
    data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS, seed: int = 0
) -> dict[str, Any]:
    """Return the summaries of the runs; the data folder is not used."""
    figures = {}
    for part in parts:
        progress(f"chaos {part}")
        figures[part] = _run(MINUTES[part], seed)
    return figures


def _run(minutes: int, seed: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "summary.json"
        command = [sys.executable, "-m", "tests.chaos", "--minutes", str(minutes), "--seed", str(seed)]
        completed = subprocess.run([*command, "--out", str(out)], cwd=ROOT, capture_output=True, check=False)
        if not out.is_file():
            error = completed.stderr.decode(errors="replace").strip()[-500:]
            raise UnavailableError(f"the chaos run ended with {completed.returncode} and no summary: {error}")
        summary: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    return summary


def table(figures: Mapping[str, Any]) -> str:
    """Return the tables of the promises and of the memory."""
    promises = [
        "| run | disturbances | promised products | requests | alarms raised, of expected | violations |",
        "|---|---|---|---|---|---|",
        *(_promises_row(name, run) for name, run in figures.items()),
    ]
    memory = [
        "| service | run | at the start | largest | at the end | bound "
        "| change per hour: MB, descriptors, threads |",
        "|---|---|---|---|---|---|---|",
        *(
            f"| `{service}` | {_label(name)} | {m['before']:.0f} MB | {m['peak']:.0f} MB "
            f"| {m['after']:.0f} MB | {m['limit']} MB | {_slopes(m.get('slopes_per_hour'))} |"
            for name, run in figures.items()
            for service, m in run["memory_mb"].items()
        ),
    ]
    violations = [f"- {_label(name)}: {v}" for name, run in figures.items() for v in run["violations"]]
    return "\n".join([*promises, "", *memory, *(["", *violations] if violations else [])])


def _promises_row(name: str, run: Mapping[str, Any]) -> str:
    counts = ", ".join(f"{disturbance} {n}" for disturbance, n in run["disturbances"].items())
    outcomes = run["requests"]["outcomes"]
    junk = sum(n for outcome, n in outcomes.items() if outcome.startswith("junk"))
    errors = sum(n for outcome, n in outcomes.items() if outcome.endswith("Error") and ":" not in outcome)
    alarms = ", ".join(f"`{kind}` {a['seen']} of {a['expected']}" for kind, a in run["alarms"].items())
    return (
        f"| {_label(name)} | {counts} | {run['products']['promised']} | {run['requests']['sent'] - junk}, "
        f"of which {errors} ended with a typed error; {junk} malformed | {alarms} "
        f"| {len(run['violations'])} |"
    )


def _slopes(slopes: Mapping[str, float] | None) -> str:
    if slopes is None:
        return "not recorded"
    return f"{slopes['memory_mb']:+.0f} MB, {slopes['descriptors']:+.1f}, {slopes['threads']:+.1f}"


def _label(name: str) -> str:
    return name.replace("_", " ")
