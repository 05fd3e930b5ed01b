# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Take-over and hand-over of a robot: restarts of both orchestrators, lost answers, an unreadable history."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import keys
from cdff_common.clock import ManualClock
from cdff_common.errors import CdffError, DeadlineError, InputError, NoAnswerError
from cdff_common.interfaces.profile import load_profile
from cdff_common.loops import Loops
from cdff_core.orchestration.journal import recover
from cdff_core.orchestration.world import ProviderId, SensorId
from cdff_dev.mission_replay.virtual import Scheduler, VirtualTiming
from services.orchestrator.control import TAKE_OVER_S, Control
from services.orchestrator.delegations import Delegations
from services.orchestrator.journal import Journal
from services.orchestrator.state import SystemState
from tests.support.recording_bus import Call, RecordingBus

PROFILE = load_profile(Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml")
MAPPER, LIDAR = ProviderId("mana", "digital_elevation_mapping"), SensorId("mana", "lidar")
OWN = keys.alive("mana", "orchestrator")


def activation(origin: str, ordinal: int, dfpc: str = str(MAPPER)) -> dict[str, Any]:
    """Return a record of the history of the DPM."""
    fields = {"kind": "activation", "dfpc": dfpc, "action": "activate", "ok": True}
    return {**fields, "origin": f"orchestrator/{origin}", "ordinal": ordinal}


class Reconciler:
    """Reconciler double."""

    is_acting = False

    def is_acting_on(self, robot: str) -> bool:
        return self.is_acting and robot == "mana"


class Ground:
    """Control of mana by the ground in virtual time; robots and DPM are functions of the test."""

    def __init__(self, folder: Path) -> None:
        self.history: list[dict[str, Any]] | CdffError = []
        self.hand_over: dict[str, Any] | CdffError = {}
        self.folder, self.reconciler = folder, Reconciler()
        self.start()

    def start(self) -> None:
        """Start a process on the ground; the earlier one is killed."""
        self.scheduler = Scheduler()
        timing = VirtualTiming(self.scheduler)
        self.bus: Any = RecordingBus(self.answer)
        self.state, loops = SystemState(PROFILE, timing), Loops(timing.now_s)
        self.journal = Journal(self.folder / "journal.jsonl")
        recovered = recover(self.journal.records())
        self.state.recover(recovered.owned, recovered.modes)
        delegations = Delegations(self.bus, self.state, loops, ManualClock(0), timing)
        reconciler: Any = self.reconciler
        self.control = Control(self.bus, self.state, reconciler, delegations, self.journal, loops, timing)
        self.control.start()

    def answer(self, call: Call) -> dict[str, Any] | CdffError | None:
        if call.verb == "history":
            if isinstance(self.history, CdffError):
                return self.history
            return {"items": [r for r in self.history if r["ordinal"] > call.parameters["since"]]}
        return self.hand_over if call.verb == "hand_over" else {"jobs": []}

    def set_present(self, is_present: bool) -> None:
        """Let the token of the orchestrator of mana appear or disappear."""
        self.bus.on_alive(OWN, is_present)

    def run(self, seconds: float) -> None:
        """Let virtual time pass."""
        until_s = self.scheduler.now_s + seconds
        timer = self.scheduler.start(lambda: self.scheduler.sleep(seconds), "test")
        while not timer.done and self.scheduler.now_s <= until_s:
            assert self.scheduler.step()

    @property
    def owned(self) -> set[ProviderId]:
        return self.state.changes("mana")[0]

    @property
    def handed_over(self) -> list[Any]:
        return [call.body for call in self.bus.of("hand_over")]

    @property
    def records(self) -> list[str]:
        return [r["action"] for r in self.journal.records() if r.get("robot") == "mana"]


@pytest.fixture
def ground(tmp_path: Path) -> Iterator[Ground]:
    ground = Ground(tmp_path)
    yield ground
    ground.journal.close()


def test_a_robot_without_orchestrator_is_taken_over_with_the_dfpcs_of_the_lost_one(ground: Ground) -> None:
    ground.history = [
        activation("mana", 1),
        activation("rover_traverse", 2, "mana/lidar_slam"),  # by the ground, before an earlier hand-over
        {"kind": "mode", "sensor": str(LIDAR), "ok": True, "origin": "orchestrator/mana", "ordinal": 3},
    ]
    ground.run(TAKE_OVER_S - 0.1)
    assert not ground.state.controls("mana")
    ground.run(0.2)
    assert ground.state.controls("mana")
    assert ground.state.changes("mana") == ({MAPPER}, {LIDAR})
    assert ground.records == ["take_over"]


def test_a_token_that_returns_in_time_prevents_the_take_over(ground: Ground) -> None:
    ground.set_present(True)
    ground.run(5.0)
    ground.set_present(False)
    ground.run(TAKE_OVER_S - 0.2)
    ground.set_present(True)
    ground.run(5.0)
    assert not ground.state.controls("mana")
    assert ground.records == []


def test_the_dfpcs_of_both_owners_are_handed_back_once(ground: Ground) -> None:
    ground.history = [activation("mana", 1)]
    ground.run(2.0)
    ground.state.add_mode_change(LIDAR)
    ground.set_present(True)
    ground.run(1.0)
    assert ground.handed_over == [{"owned": [str(MAPPER)], "sensors": [str(LIDAR)]}]
    assert not ground.state.controls("mana")
    assert ground.state.changes("mana") == (set(), set())
    assert ground.records == ["take_over", "hand_back"]
    # A second kill: the DFPCs passed on are known from the history of the robot.
    ground.set_present(False)
    ground.run(2.0)
    assert ground.owned == {MAPPER}
    assert ground.records == ["take_over", "hand_back", "take_over"]


def test_running_actions_end_before_the_hand_over(ground: Ground) -> None:
    ground.run(2.0)
    ground.reconciler.is_acting = True
    ground.set_present(True)
    ground.run(0.5)
    assert ground.handed_over == []
    assert not ground.state.controls("mana")  # no new action begins
    ground.state.set_owned(MAPPER, owned=True)  # the result of the last one
    ground.reconciler.is_acting = False
    ground.run(0.5)
    assert ground.handed_over == [{"owned": [str(MAPPER)], "sensors": []}]


@pytest.mark.parametrize("error", [NoAnswerError("none"), DeadlineError("late"), InputError("unknown")])
def test_a_hand_over_without_acceptance_is_repeated_with_all_changes(
    ground: Ground, error: CdffError
) -> None:
    ground.history, ground.hand_over = [activation("mana", 1)], error
    ground.run(2.0)
    ground.set_present(True)
    ground.run(1.0)
    assert not ground.state.controls("mana")  # its orchestrator has the robot, and in time the changes
    assert ground.owned == {MAPPER}
    ground.hand_over = {}
    ground.run(11.0)
    assert ground.handed_over[-1] == ground.handed_over[0]
    assert ground.owned == set()
    assert ground.records == ["take_over", "hand_back"]


def test_a_process_on_the_ground_hands_back_what_an_earlier_one_has_taken_over(ground: Ground) -> None:
    ground.history = [activation("mana", 1)]
    ground.run(2.0)
    ground.journal.close()
    ground.start()
    ground.set_present(True)
    ground.run(1.0)
    assert ground.handed_over == [{"owned": [str(MAPPER)], "sensors": []}]
    assert ground.records == ["take_over", "hand_back"]


def test_without_a_dpm_the_robot_is_taken_over_at_once_and_its_dfpcs_are_known_later(ground: Ground) -> None:
    ground.history = NoAnswerError("no DPM")
    ground.run(2.0)
    assert ground.state.controls("mana")
    assert ground.owned == set()
    ground.history = [activation("mana", 1)]
    ground.run(1.0)
    assert ground.owned == {MAPPER}
    calls = len(ground.bus.of("history"))
    ground.run(5.0)
    assert len(ground.bus.of("history")) == calls


def test_the_history_is_read_to_its_end(ground: Ground, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.orchestrator.control.MAX_PAGE", 1)
    ground.history = [activation("mana", 1)]
    ground.run(2.0)
    assert [c.parameters["since"] for c in ground.bus.of("history") if c.parameters["scope"] == "mana"] == [
        0,
        1,
    ]
    assert ground.owned == {MAPPER}
