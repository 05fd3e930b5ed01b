# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Differences of two runs as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cdff_common.terminal import table as columns


def table(results: Mapping[str, Any]) -> str:
    """Return the differences as text for a terminal; parts without a difference are one line."""
    lines = [f"A: {results['a']}", f"B: {results['b']}"]
    for part in ("configuration", "quality", "cost"):
        rows = [(name, _text(count_a), _text(count_b)) for name, (count_a, count_b) in results[part].items()]
        lines += ["", *columns((part, "A", "B"), rows)] if rows else ["", f"{part}: no difference"]
    for part, header in (("trajectories", "trajectory"), ("maps", "map")):
        compared = [(name, _differences(values)) for name, values in results[part].items()]
        lines += ["", *columns((header, "difference of A from B"), compared)] if compared else []
    if requests := results["requests"]:
        count_a, count_b = requests["count"]
        lines += ["", f"requests: {count_a} and {count_b}, {len(requests['different'])} answered differently"]
        lines += columns(
            ("request", "A", "B"),
            [(n, count_a, count_b) for n, (count_a, count_b) in requests["different"].items()],
        )
        for name, times in zip("AB", requests["after_s"], strict=True):
            lines.append(f"time to the answer in {name}: {_differences(times)} s")
    for name in "ab":
        if files := results[f"only_in_{name}"]:
            lines += ["", f"only in {name.upper()}: {', '.join(files)}"]
    return "\n".join(lines)


def _text(value: Any) -> str:
    return "-" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def _differences(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {_text(value)}" for name, value in values.items())
