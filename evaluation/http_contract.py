# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Send generated requests and sequences of requests to each operation of the DPM's HTTP interface.

An evaluation passes if no answer is 5xx and every answer agrees with the OpenAPI document; otherwise it
raises the failure, which contains the request.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from evaluation.runs.http_contract import (
    application,
    check_operation,
    check_sequences,
    document_of,
    operations,
)

#: Requests to each operation; the number of sequences is five times as large.
OPTIONS = {"count": 200}
_STEPS = 10


def evaluate(data: Path, progress: Callable[[str], None], count: int = OPTIONS["count"]) -> dict[str, Any]:
    """Return the numbers of requests and answers of single requests and of sequences."""
    single: Counter[int] = Counter()
    with tempfile.TemporaryDirectory() as name, application(Path(name)) as app:
        document, known = document_of(app), operations()
        for method, path in known:
            progress(f"http_contract: {method} {path}")
            single += check_operation(document, method, path, count)
    with tempfile.TemporaryDirectory() as name:
        progress("http_contract: sequences")
        answers = check_sequences(Path(name), 5 * count, _STEPS)
    sequences = sum(answers.values(), Counter[int]())
    return {
        "single": {"operations": len(known), **_counts(single)},
        "sequences": {"count": 5 * count, "steps": _STEPS, "operations": len(answers), **_counts(sequences)},
    }


def table(figures: Mapping[str, Any]) -> str:
    """Return the table of requests and answers."""
    lines = ["| requests | operations | number | 2xx | 3xx | 4xx | 5xx |", "|---|---|---|---|---|---|---|"]
    for name, title in (("single", "single"), ("sequences", "in sequences")):
        row = figures[name]
        classes = " | ".join(str(row["answers"].get(c, 0)) for c in ("2xx", "3xx", "4xx", "5xx"))
        lines.append(f"| {title} | {row['operations']} | {row['requests']} | {classes} |")
    return "\n".join(lines)


def _counts(answers: Mapping[int, int]) -> dict[str, Any]:
    classes: Counter[str] = Counter()
    for status, number in answers.items():
        classes[f"{status // 100}xx"] += number
    return {"requests": sum(answers.values()), "answers": dict(sorted(classes.items()))}
