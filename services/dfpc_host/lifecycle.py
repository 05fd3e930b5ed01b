# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Life cycle of a hosted DFPC, as data: which verb leads from which state to which."""

from __future__ import annotations

from enum import StrEnum

from cdff_common.errors import NotActiveError


class State(StrEnum):
    """Where a hosted DFPC stands."""

    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    ACTIVE = "active"
    ERROR = "error"


#: (verb, state) -> state. A verb in a state that is not listed is refused.
TRANSITIONS: dict[tuple[str, State], State] = {
    ("configure", State.UNCONFIGURED): State.INACTIVE,
    ("configure", State.INACTIVE): State.INACTIVE,
    ("configure", State.ERROR): State.INACTIVE,
    ("activate", State.INACTIVE): State.ACTIVE,
    ("activate", State.ACTIVE): State.ACTIVE,
    ("deactivate", State.ACTIVE): State.INACTIVE,
    ("deactivate", State.INACTIVE): State.INACTIVE,
}


def next_state(verb: str, state: State, name: str) -> State:
    """Return where ``verb`` leads; raises NotActiveError where it is not allowed."""
    target = TRANSITIONS.get((verb, state))
    if target is None:
        allowed = sorted({s for v, s in TRANSITIONS if v == verb})
        raise NotActiveError(f"{name} is {state}: {verb} is allowed when {' or '.join(allowed)}")
    return target
