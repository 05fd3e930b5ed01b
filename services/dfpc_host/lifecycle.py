# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Life cycle of a hosted DFPC: the table of ``cdff_core.orchestration.lifecycle`` as states and verbs."""

from __future__ import annotations

from enum import StrEnum

from cdff_common.errors import NotActiveError
from cdff_core.orchestration.lifecycle import DFPC_TRANSITIONS


class State(StrEnum):
    """Where a hosted DFPC stands."""

    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    ACTIVE = "active"
    ERROR = "error"


def next_state(verb: str, state: State, name: str) -> State:
    """Return where ``verb`` leads; raises NotActiveError where it is not allowed."""
    target = DFPC_TRANSITIONS.get((str(state), verb))
    if target is None:
        allowed = sorted({s for s, v in DFPC_TRANSITIONS if v == verb})
        raise NotActiveError(f"{name} is {state}: {verb} is allowed when {' or '.join(allowed)}")
    return State(target)
