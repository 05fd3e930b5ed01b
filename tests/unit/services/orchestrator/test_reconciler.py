# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Execution of actions: after the robot was handed back, and of a mode that is refused."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from cdff_common.errors import CdffError, DeniedError
from cdff_common.interfaces.profile import load_profile
from cdff_common.loops import Loops
from cdff_core.orchestration.planner import Plan
from cdff_core.orchestration.world import ProviderId, SensorId
from cdff_dev.mission_replay.virtual import Scheduler, VirtualTiming
from services.alarms import Alarms
from services.orchestrator.journal import Journal
from services.orchestrator.mode_alarms import ModeAlarms
from services.orchestrator.reconciler import Reconciler
from services.orchestrator.state import SystemState
from tests.support.recording_bus import Call, RecordingBus

PROFILE = load_profile(Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml")
MAPPER, LIDAR = ProviderId("mana", "digital_elevation_mapping"), SensorId("mana", "lidar")


class Actions:
    """Reconciler with a request for a map, and its actions, which are not executed yet."""

    def __init__(self, journal: Journal, mode_error: CdffError | None = None) -> None:
        timing = VirtualTiming(Scheduler())
        self.mode_error = mode_error
        self.bus: Any = RecordingBus(self.answer)
        self.state = SystemState(PROFILE, timing)
        loops, alarms = Loops(timing.now_s), ModeAlarms(Alarms())
        self.reconciler = Reconciler(self.bus, self.state, journal, loops, alarms, timing)
        self.state.set_alive(MAPPER, alive=True)
        self.state.hold("job", Plan(MAPPER, "dem", (MAPPER,), {LIDAR: "scanning"}, 1.0), 3)
        self.submitted: list[Any] = []
        self.reconciler._pool.submit = lambda call, *arguments: self.submitted.append((call, arguments))
        self.reconciler._submit_actions(None)
        assert any(arguments[1] == LIDAR for _, arguments in self.submitted)

    def answer(self, call: Call) -> dict[str, Any] | CdffError:
        if call.verb == "set_mode" and self.mode_error is not None:
            return self.mode_error
        return {"confirmed": True, "mode": call.parameters.get("mode"), "state": "active"}

    def execute(self) -> None:
        for call, arguments in self.submitted:
            call(*arguments)


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    with closing(Journal(tmp_path / "journal.jsonl")) as opened:
        yield opened


def test_an_action_is_not_executed_after_the_robot_was_handed_back(journal: Journal) -> None:
    actions = Actions(journal)
    actions.state.set_control("mana", controlled=False)
    actions.execute()
    assert not [call.key for call in actions.bus.calls if "/mana/" in call.key]
    assert not actions.reconciler.is_acting_on("mana")


@pytest.mark.parametrize(("error", "reason"), [(None, ""), (DeniedError("motors are hot"), "motors are hot")])
def test_every_command_of_a_mode_is_recorded_with_the_reason_of_its_refusal(
    journal: Journal, error: CdffError | None, reason: str
) -> None:
    actions = Actions(journal, error)
    actions.execute()
    modes = [r for r in journal.records() if r["kind"] == "mode" and r["sensor"] == "mana/lidar"]
    assert [(r["mode"], r["ok"]) for r in modes] == [("scanning", error is None)]
    assert reason in modes[0]["reason"]
