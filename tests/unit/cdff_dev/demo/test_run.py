# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every request of a demonstration counts, whatever becomes of it."""

import pytest

from cdff_common.clock import MissionClock
from cdff_dev.demo import run
from cdff_dev.demo.script import Ask, Script


def test_a_request_that_breaks_the_demonstration_is_one_that_was_not_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(ask: Ask, *_: object) -> run.Outcome:
        if ask.type == "dem":
            raise TypeError("a bug")
        return run.Outcome(ask, (), 0.0)

    monkeypatch.setattr(run, "_ask", broken)
    fields = {"at_s": 0, "robot": "mana", "max_age_s": 1, "deadline_ms": 1000}
    script = Script(profile="p", requests=tuple(Ask(type=t, **fields) for t in ("pose", "dem")))
    shown: list[run.Outcome] = []
    outcomes = run.run_script(script, MissionClock(), 0, "", "", shown.append)
    assert [o.faults for o in outcomes] == [(), ("TypeError: a bug",)]
    assert len(shown) == 2
