# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The diagrams of the state machines show the transitions of the tables."""

from __future__ import annotations

import re

from cdff_core.orchestration.lifecycle import DFPC_TRANSITIONS, FINAL_STATES, JOB_TRANSITIONS
from cdff_dev.generate.reference.states import diagram, page


def arrows(text: str) -> set[tuple[str, str]]:
    return set(re.findall(r"^    (\w+) --> (\w+)", text, re.MULTILINE))


def test_exactly_the_transitions_of_the_tables_are_drawn() -> None:
    job, dfpc = page().split("```mermaid")[1:3]
    drawn_arrows = arrows(job)
    ends = {s for s in FINAL_STATES if s != "done"}
    assert drawn_arrows == {
        (str(a), str(b)) for a, following in JOB_TRANSITIONS.items() for b in following - ends
    }
    assert arrows(dfpc) == {(start, end) for (start, _), end in DFPC_TRANSITIONS.items()}


def test_labels_between_the_same_states_are_joined() -> None:
    text = diagram([("a", "b", "go"), ("a", "b", "run"), ("b", "a", "")], "a", ["b"])
    assert "    a --> b: go, run\n" in text
    assert "    b --> a\n" in text
    assert text.index("[*] --> a") < text.index("b --> [*]")
