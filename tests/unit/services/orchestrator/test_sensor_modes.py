# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensor modes of the orchestrator: fallback after a refusal, confirmation, release after the last user."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Reply, keys
from cdff_common.errors import UnavailableError
from cdff_common.interfaces.registry import Registry
from cdff_core.orchestration.world import SensorId
from tests.support import orchestrator_mission
from tests.support.orchestrator_stage import DEM, Stage, provider_of

#: Two DFPCs with the same product, each in its own mode of the lidar.
TWO_MODES = {
    "dem": {"modes": {"lidar": "slow"}},
    "stereo_dem": {
        "inputs": {"stereo": "sensor/lidar/scan", "poses": "product/position/pose"},
        "modes": {"lidar": "fast"},
    },
}
LIDAR = SensorId("mana", "lidar")


@pytest.fixture(autouse=True)
def simulated_registry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        Registry, "default", classmethod(lambda cls: orchestrator_mission.SimulatedRegistry())
    )


def refuse(stage: Stage, *modes: str) -> None:
    """Let the lidar of mana refuse some modes."""
    stage.refuse("lidar", modes)


def first_demand_s(stage: Stage, mode: str) -> float:
    return next(at_s for at_s, sensor, m in stage.mission.mode_demands if (sensor, m) == ("lidar", mode))


@pytest.mark.req("CDFF-SUP-027")
@pytest.mark.parametrize(
    ("fault", "limit_s", "alarm"),
    [
        ("refused", 1.0, "mode_refused"),
        ("hangs", 10.0, "unit_silent"),
        ("not confirmed", 1.0, "mode_unconfirmed"),
        ("malformed", 1.0, "mode_unconfirmed"),
    ],
)
def test_another_mode_of_the_sensor_replaces_one_that_is_not_reached_and_an_alarm_reports_it(
    tmp_path: Path, fault: str, limit_s: float, alarm: str
) -> None:
    stage = Stage(tmp_path, orchestrator_mission.profile(**TWO_MODES))
    if fault == "refused":
        refuse(stage, "slow")
    else:
        answers = {
            "hangs": None,
            "not confirmed": {"confirmed": False, "sensor": "lidar", "mode": "off"},
            "malformed": ["slow"],
        }
        stage.mission.mode_answers["slow"] = answers[fault]
    reply = stage.final_answer(stage.send(**DEM))
    assert provider_of(reply) == "stereo_dem"
    assert first_demand_s(stage, "fast") - first_demand_s(stage, "slow") <= limit_s
    (active,) = stage.orchestrator.alarms.active()
    assert (active.kind, active.source) == (alarm, "mana/lidar/slow")


@pytest.mark.req("CDFF-SUP-027")
def test_a_refused_mode_is_the_reason_and_not_demanded_again_for_a_while(tmp_path: Path) -> None:
    stage = Stage(tmp_path, orchestrator_mission.profile(**TWO_MODES))
    refuse(stage, "slow", "fast")
    for _ in range(3):
        error = stage.final_answer(stage.send(**DEM))
        assert isinstance(error, UnavailableError)
        assert "refuse" in str(error)
        assert "another request" not in str(error)
        stage.run(5.0)
    demands = [mode for _, sensor, mode in stage.mission.mode_demands if sensor == "lidar" and mode != "off"]
    assert sorted(demands) == ["fast", "slow"]
    stage.run(35.0)
    refuse(stage)
    assert isinstance(stage.final_answer(stage.send(**DEM)), Reply)


def test_an_alternative_of_an_always_active_dfpc_replaces_a_refused_mode(tmp_path: Path) -> None:
    profile = orchestrator_mission.profile(slam={"activation": "always", "modes": {"lidar": "slow|fast"}})
    stage = Stage(tmp_path, profile, refuses={"lidar": ("slow",)})
    assert stage.run_until(lambda: stage.process("slam").state == "active", 20.0)
    assert stage.orchestrator._state._observed.modes[LIDAR] == "fast"


def test_an_unconfirmed_mode_activates_no_dfpc(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    answer = {"confirmed": False, "mode": "off", "sensor": "lidar"}
    stage.mission.mode_answers |= dict.fromkeys(("slow", "dense", "fast"), answer)
    stage.mission.stop(stage.process("stereo_dem"))
    error = stage.final_answer(stage.send(**{**DEM, "deadline_ms": "8000"}))
    assert isinstance(error, UnavailableError)
    assert "confirmed" in str(error)
    assert stage.orchestrator._state._observed.modes.get(LIDAR, "off") == "off"
    assert stage.process("dem").state != "active"


@pytest.mark.req("CDFF-SUP-145")
def test_a_sensor_returns_to_its_initial_mode_after_the_linger_time_of_its_last_user(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    assert isinstance(stage.final_answer(stage.send(**DEM)), Reply)
    assert stage.process("position").state == "active"
    linger_s = next(e.linger_s for e in stage.mission.profile.robot("mana").dfpcs if e.name == "dem")

    def lidar_mode() -> Any:
        return stage.mission.icu.modes("mana")["sensors"]["lidar"]["mode"]

    assert lidar_mode() != "off"
    assert stage.run_until(lambda: lidar_mode() == "off", linger_s + 5.0)
    assert stage.process("position").state == "active"


def test_repeated_requests_for_recent_products_keep_their_dfpcs_active(tmp_path: Path) -> None:
    """All but the first are served from the DPM; without them the DFPCs end after 5 and 10 s."""
    stage = Stage(tmp_path)
    chain = [stage.process("navigation"), stage.process("dem")]
    for _ in range(10):
        reply = stage.final_answer(stage.send(**{**DEM, "type": "navigation_map"}))
        assert isinstance(reply, Reply)
        assert not stage.run_until(lambda: any(p.state != "active" for p in chain), 1.0)
    assert stage.journal_text().count("navigation shall provide it") == 1
    stage.run_until(lambda: chain[1].state != "active", 15.0)
    without_largest_age = {"type": "navigation_map", "robot": "mana"}
    for _ in range(5):
        stage.final_answer(stage.send(**without_largest_age))
        stage.run(3.0)
    assert all(process.state != "active" for process in chain), "a stored product of any age is enough"


@pytest.mark.parametrize(
    "body",
    [["a list"], {}, {"sensors": [1]}, {"sensors": {"lidar": 3}}, {"sensors": {"lidar": {"mode": []}}}],
)
def test_a_malformed_answer_of_the_unit_is_counted_and_the_next_host_is_met(
    tmp_path: Path, body: Any
) -> None:
    stage = Stage(tmp_path)
    dem = stage.process("dem")
    stage.mission.stop(dem)
    stage.run(1.0)
    stage.mission.modes_answer = body
    stage.mission.token(keys.alive("mana", "icu"), present=True)
    stage.run(1.0)
    stage.mission.start(dem)
    stage.run(1.0)
    assert dem.id in stage.orchestrator._state._observed.alive
    loops = stage.call("stat")["loops"]
    assert loops["watcher"]["errors"] == 1
    assert loops["watcher"]["last_error"]
    assert all(loop["healthy"] for loop in loops.values())
