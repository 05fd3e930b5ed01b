# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""State machines of a job and of a DFPC as tables, which are also the source of their documentation."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from cdff_common.errors import ConflictError


class JobState(StrEnum):
    """State of the job of a request."""

    RECEIVED = "received"
    LOOKING = "looking"
    PLANNING = "planning"
    PREPARING = "preparing"
    WAITING = "waiting"
    DELIVERING = "delivering"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


_J = JobState
_ENDS = frozenset({_J.FAILED, _J.CANCELLED})
#: State -> states that may follow. PREPARING and WAITING return to PLANNING when a DFPC or sensor fails.
JOB_TRANSITIONS: Mapping[JobState, frozenset[JobState]] = {
    _J.RECEIVED: frozenset({_J.LOOKING}) | _ENDS,
    _J.LOOKING: frozenset({_J.PLANNING, _J.DELIVERING}) | _ENDS,
    _J.PLANNING: frozenset({_J.PREPARING, _J.DELIVERING}) | _ENDS,
    _J.PREPARING: frozenset({_J.WAITING, _J.PLANNING, _J.DELIVERING}) | _ENDS,
    _J.WAITING: frozenset({_J.DELIVERING, _J.PLANNING, _J.PREPARING}) | _ENDS,
    _J.DELIVERING: frozenset({_J.DONE, _J.WAITING}) | _ENDS,
    _J.DONE: frozenset(),
    _J.FAILED: frozenset(),
    _J.CANCELLED: frozenset(),
}
FINAL_STATES = frozenset(s for s, following in JOB_TRANSITIONS.items() if not following)

#: DFPC life cycle: (state, verb) -> state. ``fail`` is an event, not a call.
DFPC_TRANSITIONS: Mapping[tuple[str, str], str] = {
    ("unconfigured", "configure"): "inactive",
    ("unconfigured", "clean_up"): "unconfigured",
    ("inactive", "configure"): "inactive",
    ("inactive", "activate"): "active",
    ("inactive", "deactivate"): "inactive",
    ("inactive", "clean_up"): "unconfigured",
    ("inactive", "fail"): "error",
    ("active", "activate"): "active",
    ("active", "deactivate"): "inactive",
    ("active", "fail"): "error",
    ("error", "configure"): "inactive",
    ("error", "clean_up"): "unconfigured",
}


def next_job_state(state: JobState, to: JobState) -> JobState:
    """Return ``to`` if the transition from ``state`` is allowed; raises ConflictError otherwise."""
    if to not in JOB_TRANSITIONS[state]:
        raise ConflictError(f"job is {state}: it cannot become {to}")
    return to
