# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``state-machines.md``: diagrams of the transition tables of ``cdff_core.orchestration``."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping

from cdff_core.orchestration.lifecycle import DFPC_TRANSITIONS, FINAL_STATES, JOB_TRANSITIONS, JobState
from cdff_core.orchestration.modes import MODE_TRANSITIONS

_HEAD = """<!-- GENERATED from cdff_core.orchestration by cdff generate; do not edit. -->
# State machines

Transitions of the jobs of the orchestrator, of DFPCs and of sensors. All other transitions are refused.
"""
_JOB = """
## Job of a request

`lifecycle.JOB_TRANSITIONS`. Each change is written with its reason to the journal, then published, and then
stored in the history of the DPM. Every state that is not final also has transitions to `failed` and
`cancelled`.
"""
_DFPC = """
## DFPC

`lifecycle.DFPC_TRANSITIONS`. `fail` is an event; the other labels are requests.
"""
_MODE = """
## Mode of a sensor in the instrument control unit

`modes.MODE_TRANSITIONS`. `demand` is a request; the other labels are events.
"""


def page() -> str:
    """Return the page of all state machines."""
    ends = {JobState.FAILED, JobState.CANCELLED}
    jobs = [(str(a), str(b), "") for a, following in JOB_TRANSITIONS.items() for b in following - ends]
    job = diagram(jobs, JobState.RECEIVED, FINAL_STATES - ends)
    dfpc = diagram(_label(DFPC_TRANSITIONS), "unconfigured")
    return "\n".join([_HEAD, _JOB, job, _DFPC, dfpc, _MODE, diagram(_label(MODE_TRANSITIONS), "steady")])


def diagram(edges: Iterable[tuple[str, str, str]], initial: str, final: Iterable[str] = ()) -> str:
    """Return a Mermaid state diagram of edges ``(from, to, label)``; labels of equal edges are joined."""
    labels: dict[tuple[str, str], set[str]] = defaultdict(set)
    for start, end, label in edges:
        labels[start, end] |= {label} - {""}
    lines = ["```mermaid", "stateDiagram-v2", f"    [*] --> {initial}"]
    for (start, end), names in sorted(labels.items()):
        lines.append(f"    {start} --> {end}" + (f": {', '.join(sorted(names))}" if names else ""))
    return "\n".join([*lines, *(f"    {state} --> [*]" for state in sorted(final)), "```", ""])


def _label(table: Mapping[tuple[str, str], str]) -> list[tuple[str, str, str]]:
    """Return the transitions of a table as (start, end, verb)."""
    return [(start, end, verb) for (start, verb), end in table.items()]
