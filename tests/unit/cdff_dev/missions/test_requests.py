# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every request of a mission has an outcome, also if it raises an error."""

import pytest

from cdff_common.mission_clock import MissionClock
from cdff_dev.missions import requests
from cdff_dev.missions.script import TimedRequest


def test_a_request_that_raises_an_error_has_an_outcome_with_that_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def send_with_a_bug(request: TimedRequest, *_: object) -> requests.Outcome:
        if request.type == "dem":
            raise TypeError("a bug")
        return requests.Outcome(request, (), 0.0)

    monkeypatch.setattr(requests, "send_request", send_with_a_bug)
    fields = {"at_s": 0, "robot": "mana", "max_age_s": 1, "deadline_ms": 1000}
    script = [TimedRequest(type=t, **fields) for t in ("pose", "dem")]
    reported: list[requests.Outcome] = []
    outcomes = requests.run_requests(script, MissionClock(), 0, "", "", reported.append)
    assert [o.faults for o in outcomes] == [(), ("TypeError: a bug",)]
    assert len(reported) == 2
