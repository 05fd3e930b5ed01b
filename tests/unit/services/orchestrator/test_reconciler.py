# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Actions of an orchestrator that loses the control of their robot before they are executed."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

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
from tests.support.recording_bus import RecordingBus

PROFILE = load_profile(Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml")
MAPPER, LIDAR = ProviderId("mana", "digital_elevation_mapping"), SensorId("mana", "lidar")


def test_an_action_is_not_executed_after_the_robot_was_handed_back(tmp_path: Path) -> None:
    scheduler = Scheduler()
    timing = VirtualTiming(scheduler)
    bus: Any = RecordingBus(
        lambda call: {"confirmed": True, "mode": call.parameters.get("mode"), "state": "active"}
    )
    state = SystemState(PROFILE, timing)
    with closing(Journal(tmp_path / "journal.jsonl")) as journal:
        loops = Loops(timing.now_s)
        reconciler = Reconciler(bus, state, journal, loops, ModeAlarms(Alarms()), timing)
        state.set_alive(MAPPER, alive=True)
        state.hold("job", Plan(MAPPER, "dem", (MAPPER,), {LIDAR: "scanning"}, 1.0), 3)
        submitted = []
        reconciler._pool.submit = lambda call, *arguments: submitted.append((call, arguments))
        reconciler._submit_actions(None)
        assert any(arguments[1] == LIDAR for _, arguments in submitted)
        state.set_control("mana", controlled=False)
        for call, arguments in submitted:
            call(*arguments)
        assert not [call.key for call in bus.calls if "/mana/" in call.key]
        assert not reconciler.is_acting_on("mana")
