# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``state-machines.md``: diagrams of the tables of ``cdff_core.orchestration``."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping

from cdff_core.orchestration.lifecycle import DFPC_TRANSITIONS, FINAL_STATES, JOB_TRANSITIONS, JobState
from cdff_core.orchestration.modes import MODE_TRANSITIONS

_HEAD = """<!-- GENERATED from cdff_core.orchestration by cdff generate; do not edit. -->
# State machines

Transitions of the orchestrator's jobs, the DFPC hosts and the instrument control unit.
All others are refused.
"""
_JOB = """
## A request's job

`lifecycle.JOB_TRANSITIONS`. Each change, with its reason, is in the journal before it is published, and in the
DPM's history after. From every state that is not final a job may also go to `failed` or `cancelled`.
"""
_DFPC = """
## A DFPC

`lifecycle.DFPC_TRANSITIONS`. `fail` is not asked for: it happens.
"""
_MODE = """
## A sensor, as the instrument control unit runs it

`modes.MODE_TRANSITIONS`. `demand` is asked for, the others happen.
"""


def page() -> str:
    """Return the page."""
    ends = {JobState.FAILED, JobState.CANCELLED}
    jobs = [(str(a), str(b), "") for a, following in JOB_TRANSITIONS.items() for b in following - ends]
    job = diagram(jobs, JobState.RECEIVED, FINAL_STATES - ends)
    dfpc = diagram(_labelled(DFPC_TRANSITIONS), "unconfigured")
    return "\n".join([_HEAD, _JOB, job, _DFPC, dfpc, _MODE, diagram(_labelled(MODE_TRANSITIONS), "steady")])


def diagram(edges: Iterable[tuple[str, str, str]], first: str, final: Iterable[str] = ()) -> str:
    """Return a Mermaid state diagram of ``(from, to, label)`` edges, with the labels of equal edges
    joined.
    """
    labels: dict[tuple[str, str], set[str]] = defaultdict(set)
    for start, end, label in edges:
        labels[start, end] |= {label} - {""}
    lines = ["```mermaid", "stateDiagram-v2", f"    [*] --> {first}"]
    for (start, end), said in sorted(labels.items()):
        lines.append(f"    {start} --> {end}" + (f": {', '.join(sorted(said))}" if said else ""))
    return "\n".join([*lines, *(f"    {state} --> [*]" for state in sorted(final)), "```", ""])


def _labelled(table: Mapping[tuple[str, str], str]) -> list[tuple[str, str, str]]:
    return [(start, end, verb) for (start, verb), end in table.items()]
