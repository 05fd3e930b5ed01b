# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What goes wrong in a rover's thread is a fault of the mission, not a silence."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from cdff_common.clock import MissionClock
from cdff_common.errors import RefusedError
from cdff_common.interfaces.profile import load_profile
from cdff_dev.missions import run
from cdff_dev.missions.autonomy import Autonomy
from cdff_dev.missions.commands import DEPLOY
from cdff_dev.missions.script import load_mission


@pytest.mark.parametrize(
    ("error", "said"), [(TypeError("a bug"), "mana: TypeError: a bug"), (RefusedError("no way", ["no_way"]), "no way")]
)
def test_a_rover_whose_tasks_end_in_an_error_is_a_fault(
    monkeypatch: pytest.MonkeyPatch, error: Exception, said: str
) -> None:
    def fail(_self: Autonomy) -> None:
        raise error

    monkeypatch.setattr(Autonomy, "run", fail)
    mission = load_mission(DEPLOY / "missions" / "return_to_base.yaml")
    profile = load_profile(DEPLOY / "profiles" / "explorer.yaml")
    stage: Any = SimpleNamespace(connect="tcp/127.0.0.1:1", http="127.0.0.1:1", check_running=lambda: None)
    told: list[str] = []
    _, unfinished, _ = run._drive_all(mission, profile, MissionClock(), 0, stage, told.append)
    (fault,) = unfinished
    assert said in fault
    assert told == [fault]


def test_a_request_of_which_nothing_came_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Autonomy, "run", lambda _self: None)
    monkeypatch.setattr(run, "run_script", lambda *_arguments: [])
    mission = load_mission(DEPLOY / "missions" / "long_traverse_localisation.yaml")
    profile = load_profile(DEPLOY / "profiles" / "explorer.yaml")
    stage: Any = SimpleNamespace(connect="tcp/127.0.0.1:1", http="127.0.0.1:1", check_running=lambda: None)
    _, unfinished, _ = run._drive_all(mission, profile, MissionClock(), 0, stage, lambda _text: None)
    assert unfinished == ["0 of 4 requests came to an end"]
