# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Give each DFPC degenerate and wrong inputs: clouds, images, cameras, poses, maps and observations.

An answer is acceptable if the input is refused with a typed error, the output is FAILED or DEGRADED with a
reason that it does not state without the fault, or its error is at most three stated standard deviations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from evaluation.runs import wrong_bundles, wrong_clouds, wrong_images, wrong_maps, wrong_poses
from evaluation.runs.wrong_input import LIMIT_SIGMAS, Case, answer, code

_SOURCES = (wrong_clouds, wrong_images, wrong_poses, wrong_maps, wrong_bundles)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the answer to each case: DFPC -> data -> fault."""
    results: dict[str, Any] = {}
    for case in cases(data):
        progress(f"wrong_input: {case.dfpc}, {case.fault}")
        row = results.setdefault(case.dfpc, {}).setdefault(case.data, {})
        usual = [code(r) for name, a in row.items() if _is_reference(name) for r in a["reason"].split(", ")]
        row[case.fault] = answer(case, usual)
    return {"limit_sigmas": LIMIT_SIGMAS, "dfpcs": dict(sorted(results.items()))}


def cases(data: Path) -> Iterator[Case]:
    """Yield all cases; the reference without a fault is the first of its DFPC and data."""
    return chain.from_iterable(source.cases(data) for source in _SOURCES)


def _is_reference(fault: str) -> bool:
    return fault.split(": ")[-1] == "none"


def table(figures: dict[str, Any]) -> str:
    """Return the summary, the answers that are not acceptable, and all answers."""
    rows = list(_rows(figures))
    faults = [row for row in rows if not _is_reference(row[2])]
    silent = [row for row in rows if not row[3]["acceptable"]]
    accepted = sum(row[3]["acceptable"] for row in faults)
    lines = [
        f"{accepted} of {len(faults)} wrong inputs are refused, flagged, or cause an error of at most "
        f"{figures['limit_sigmas']:g} stated standard deviations.",
        "",
        "| DFPC | wrong inputs | refused or FAILED | DEGRADED | OK within the limit | not flagged |",
        "|---|---|---|---|---|---|",
        *[_summary(name, [r[3] for r in faults if r[0] == name]) for name in figures["dfpcs"]],
        "",
        "**Not flagged**",
        "",
        *_table_of(silent),
        "",
        "**All answers**",
        "",
        *_table_of(rows),
    ]
    return "\n".join(lines)


def _rows(figures: dict[str, Any]) -> Iterator[tuple[str, str, str, dict[str, Any]]]:
    for dfpc, sets in figures["dfpcs"].items():
        for data, answers in sets.items():
            for fault, row in answers.items():
                yield dfpc, data, fault, row


def _summary(dfpc: str, answers: list[dict[str, Any]]) -> str:
    accepted = [a["status"] for a in answers if a["acceptable"]]
    counts = (
        len(answers),
        sum(status in ("refused", "FAILED") for status in accepted),
        accepted.count("DEGRADED"),
        accepted.count("OK"),
        len(answers) - len(accepted),
    )
    return f"| `{dfpc}` | " + " | ".join(map(str, counts)) + " |"


def _table_of(rows: list[tuple[str, str, str, dict[str, Any]]]) -> list[str]:
    lines = ["| DFPC | data | input | answer | error, σ | reason |", "|---|---|---|---|---|---|"]
    for dfpc, data, fault, row in rows:
        error = "–" if row["error_sigmas"] is None else row["error_sigmas"]
        reason = row["reason"].replace("|", "/")
        reason = f"`{reason}`" if reason else ""
        lines.append(f"| `{dfpc}` | {data} | {fault} | {row['status']} | {error} | {reason} |")
    return lines
