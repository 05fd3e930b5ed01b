# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of rovers and unanswered requests are faults of the mission."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from cdff_common.errors import RefusedError
from cdff_common.interfaces.profile import load_profile
from cdff_common.mission_clock import MissionClock
from cdff_common.resources import deploy_folder
from cdff_dev.missions import mission_run
from cdff_dev.missions.autonomy import Autonomy
from cdff_dev.missions.script import load_mission


@pytest.mark.parametrize(
    ("error", "reason"),
    [(TypeError("a bug"), "mana: TypeError: a bug"), (RefusedError("no track", ["no_path"]), "no track")],
)
def test_a_rover_whose_tasks_end_in_an_error_is_a_fault(
    monkeypatch: pytest.MonkeyPatch, error: Exception, reason: str
) -> None:
    def fail(_self: Autonomy) -> None:
        raise error

    monkeypatch.setattr(Autonomy, "run", fail)
    mission = load_mission(deploy_folder() / "missions" / "return_to_base.yaml")
    profile = load_profile(deploy_folder() / "profiles" / "explorer.yaml")
    stage: Any = SimpleNamespace(
        profile=profile, connect="tcp/127.0.0.1:1", http="127.0.0.1:1", check_running=lambda: None
    )
    printed: list[str] = []
    _, unfinished, _ = mission_run._drive_all(mission, MissionClock(), 0, stage, printed.append)
    (fault,) = unfinished
    assert reason in fault
    assert printed == [fault]


def test_an_unanswered_request_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Autonomy, "run", lambda _self: None)
    monkeypatch.setattr(mission_run, "run_requests", lambda *_arguments: [])
    mission = load_mission(deploy_folder() / "missions" / "long_traverse_localisation.yaml")
    profile = load_profile(deploy_folder() / "profiles" / "explorer.yaml")
    stage: Any = SimpleNamespace(
        profile=profile, connect="tcp/127.0.0.1:1", http="127.0.0.1:1", check_running=lambda: None
    )
    _, unfinished, _ = mission_run._drive_all(mission, MissionClock(), 0, stage, lambda _text: None)
    assert unfinished == ["0 of 4 requests ended"]
