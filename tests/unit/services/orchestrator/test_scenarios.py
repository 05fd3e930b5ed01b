# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of the service under single failures: new plan, displaced requests, early replies.

The service runs in virtual time on the simulated mission; only what a test breaks is broken.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Reply, Request, keys
from cdff_common.errors import CdffError, DeadlineError, FrameNotFoundError, UnavailableError
from cdff_common.interfaces.registry import Registry
from cdff_core.orchestration.world import ProviderId, SensorId
from cdff_dev.mission_replay.virtual import Scheduler, VirtualTiming
from services.orchestrator import service
from services.orchestrator.service import Orchestrator
from tests.support import orchestrator_mission
from tests.support.simulated_bus import Mission

DEM = {"type": "dem", "robot": "mana", "max_age_s": "4", "deadline_ms": "40000"}


class Stage:
    """A mission without faults, an orchestrator, and clients."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.scheduler = Scheduler()
        self.mission = Mission(self.scheduler, orchestrator_mission.profile(), 1, failure_rate=0.0)
        self.lead()
        self.run_until(lambda: all(p.alive for p in self.mission.processes.values()), 10.0)
        self.run(3.0)

    def lead(self) -> None:
        self.timing = VirtualTiming(self.scheduler)
        self.bus = self.mission.connect(self.timing)
        self.orchestrator = Orchestrator(
            self.bus,
            self.mission.profile,
            self.folder / "journal.jsonl",
            8,
            self.timing,  # type: ignore[arg-type]
        )
        self.timing.start(self.orchestrator.start, "start")

    def process(self, name: str, robot: str = "mana"):  # type: ignore[no-untyped-def]
        return self.mission.processes[ProviderId(robot, name)]

    def ask(self, **wish: str) -> list[Any]:
        """Ask in a task of its own; the list collects replies and the final error."""
        got: list[Any] = []

        def client() -> None:
            try:
                got.extend(self.bus.query(keys.orchestrator_rpc("ground", "request"), wish))
            except CdffError as error:
                got.append(error)
            got.append(self.scheduler.now_s)

        self.timing.start(client, "client")
        return got

    def call(self, verb: str, **parameters: str) -> Any:
        key = keys.orchestrator_rpc("ground", verb)
        return self.bus.handlers[key](Request(key, parameters, b"", "", b"")).body()

    def run(self, seconds: float) -> None:
        self.run_until(lambda: False, seconds)

    def run_until(self, done: Callable[[], bool], limit_s: float) -> bool:
        until_s = self.scheduler.now_s + limit_s
        while self.scheduler.now_s < until_s and not done():
            assert self.scheduler.step()
        return done()

    def answer(self, got: list[Any], limit_s: float = 60.0) -> Any:
        """The final reply or error, once it is there."""
        assert self.run_until(lambda: bool(got) and isinstance(got[-1], float), limit_s), (
            "it was never answered"
        )
        return got[-2]

    def decisions(self) -> str:
        return " ".join(str(r) for r in self.orchestrator._journal.records())


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Stage:
    monkeypatch.setattr(
        Registry, "default", classmethod(lambda cls: orchestrator_mission.SimulatedRegistry())
    )
    return Stage(tmp_path)


def made_by(reply: Any) -> str:
    assert isinstance(reply, Reply), reply
    return str(reply.attachment["delivered"]["source"]).split("/")[0]


def activate(stage: Stage, **wish: str) -> list[Any]:
    """Ask, and let everything the plan needs be active, but nothing be made yet."""
    got = stage.ask(**{**DEM, **wish})
    dem = stage.process("dem", wish.get("robot", "mana"))
    assert stage.run_until(lambda: dem.state == "active", 20.0)
    return got


@pytest.mark.req("CDFF-SUP-024")
def test_an_answer_states_request_delivery_and_difference(stage: Stage) -> None:
    reply = stage.answer(stage.ask(**DEM, region="bbox:0,0,4,4", request="mine"))
    assert made_by(reply) == "dem"
    asked, given = reply.attachment["asked"], reply.attachment["delivered"]
    assert (asked["request"], asked["region"], asked["max_age_s"]) == ("mine", "bbox:0,0,4,4", 4.0)
    assert 0.0 < given["coverage"] < 1.0
    assert given["differences"] == [f"coverage: {given['coverage']:.3f} of the region holds data"]
    assert given["assembled"] == {"stored": 0.0, "made": pytest.approx(given["coverage"], abs=1e-4)}


@pytest.mark.req("CDFF-SUP-027")
@pytest.mark.parametrize("trouble", ["crash", "raise", "refuse", "deaf", "lost"])
def test_a_failed_provider_is_replaced_by_another_plan(stage: Stage, trouble: str) -> None:
    dem = stage.process("dem")
    dem.degraded = trouble == "degraded"
    dem.produces_nothing, dem.receives_nothing = trouble == "refuse", trouble == "deaf"
    got = activate(stage)
    if trouble == "lost":
        stage.mission.icu.lose("mana", "lidar", "no power")
    if trouble == "crash":
        stage.mission.stop(dem)
    for _ in range(8 if trouble == "raise" else 0):
        stage.run_until(lambda: dem.state == "active", 3.0)
        stage.mission.fail(dem)
    assert made_by(stage.answer(got)) == "stereo_dem"


@pytest.mark.req("CDFF-SUP-027")
def test_degraded_output_is_delivered_if_the_next_plan_gives_no_better(stage: Stage) -> None:
    stage.process("dem").degraded = stage.process("stereo_dem").degraded = True
    reply = stage.answer(activate(stage))
    assert "the product of mana/dem is DEGRADED" in stage.decisions()
    assert "status: DEGRADED, see its quality" in reply.attachment["delivered"]["differences"]


@pytest.mark.req("CDFF-SUP-027")
def test_an_irreplaceable_lost_sensor_is_reported_at_once(stage: Stage) -> None:
    got = activate(stage, robot="minnie")
    stage.mission.icu.lose("minnie", "lidar", "no power")
    began_s = stage.scheduler.now_s
    error = stage.answer(got)
    assert isinstance(error, UnavailableError)
    assert "sensor minnie/lidar is lost: no power" in str(error)
    assert got[-1] - began_s < 2.0
    stage.mission.icu.recover("minnie", "lidar")
    assert made_by(stage.answer(stage.ask(**{**DEM, "robot": "minnie"}))) == "dem"


@pytest.mark.req("CDFF-SUP-145")
def test_the_lower_priority_loses_the_sensor_and_is_reported(stage: Stage) -> None:
    stage.mission.stop(stage.process("position", "minnie"))
    stage.process("dem", "minnie").produces_nothing = True
    stage.process("slam", "minnie").produces_nothing = True
    stage.run(1.0)
    low = stage.ask(**{**DEM, "robot": "minnie", "priority": "3", "deadline_ms": "60000"})
    lidar = SensorId("minnie", "lidar")
    held = stage.orchestrator._state._leases.held_mode
    assert stage.run_until(lambda: held(lidar) == "slow", 20.0)
    stage.answer(stage.ask(type="pose", robot="minnie", max_age_s="1", priority="3", deadline_ms="4000"))
    assert held(lidar) == "slow", "an equal takes nothing away"
    assert not isinstance(low[-1], float)
    high = stage.ask(type="pose", robot="minnie", max_age_s="1", priority="9", deadline_ms="20000")
    error = stage.answer(low)
    assert isinstance(error, UnavailableError)
    assert "minnie/lidar is kept in mode fast by another request" in str(error)
    assert "is in mode fast for a request of higher priority" in stage.decisions()
    stage.process("slam", "minnie").produces_nothing = False
    assert isinstance(stage.answer(high), Reply)


@pytest.mark.req("CDFF-SUP-142")
def test_an_unobservable_region_is_refused_at_once_with_the_stored_coverage(stage: Stage) -> None:
    began_s = stage.scheduler.now_s
    got = stage.ask(**{**DEM, "robot": "any", "region": "bbox:300,300,310,310"})
    error = stage.answer(got)
    assert isinstance(error, UnavailableError)
    assert not isinstance(error, DeadlineError)
    assert "the DPM holds 0% of the region" in str(error)
    assert "mana can see 0% more of it in time" in str(error)
    assert got[-1] - began_s < 1.0


@pytest.mark.req("CDFF-SUP-142")
def test_of_a_partly_stored_region_only_the_rest_is_produced(stage: Stage) -> None:
    wish = {**DEM, "region": "bbox:0,0,4,4", "max_age_s": "600", "min_coverage": "0.1"}
    first = stage.answer(stage.ask(**wish)).attachment["delivered"]
    second = stage.answer(stage.ask(**{**wish, "min_coverage": "0.5", "deadline_ms": "300000"}), 300.0)
    given = second.attachment["delivered"]
    assert given["assembled"]["stored"] >= first["coverage"] - 1e-4
    assert given["assembled"]["stored"] + given["assembled"]["made"] == pytest.approx(
        given["coverage"], abs=1e-3
    )
    assert given["coverage"] >= 0.5
    assert given["assembled"]["made"] > 0.0


def test_an_unknown_frame_is_not_found_in_requests_and_explanations(stage: Stage) -> None:
    for more in ({}, {"explain": "true"}):
        error = stage.answer(stage.ask(**DEM, frame="nowhere", **more))
        assert isinstance(error, FrameNotFoundError)
        assert "nowhere" in str(error)


@pytest.mark.req("CDFF-SUP-041")
def test_an_acknowledged_job_survives_a_kill_of_the_orchestrator(stage: Stage) -> None:
    activate(stage, request="mine", progress="true")
    stage.scheduler.kill(stage.timing)
    stage.mission.buses.clear()
    stage.lead()
    stage.run(3.0)
    (job,) = stage.call("jobs", job="mine")["jobs"]
    assert (job["state"], job["reason"]) == ("failed", service.RESTARTED)
    assert job["request"]["type"] == "dem"
    assert job["job"] in {j["job"] for j in stage.call("jobs", robot="any")["jobs"]}
    dem = stage.process("dem")
    assert stage.run_until(lambda: dem.state == "inactive", 60.0), "no request holds it"


@pytest.mark.req("CDFF-SUP-070")
def test_the_catalogue_states_for_each_type_the_providers_or_the_reasons(
    stage: Stage,
) -> None:
    (dem,) = stage.call("catalogue", robot="mana", type="dem")["products"]
    assert dem["possible"]
    assert [w["dfpc"] for w in dem["by"]] == ["dem", "stereo_dem"]
    assert all(
        {"cpu_cores", "memory_mb", "ready_s", "resolution_m", "implementation"} <= set(w) for w in dem["by"]
    )
    products = stage.call("catalogue", robot="any")["products"]
    results = {(p["type"], p["robot"]): p for p in products}
    assert "no DFPC of minnie provides navigation_map" in results["navigation_map", "minnie"]["why_not"]
    assert results["navigation_map", "minnie"]["nearest"][0] == "navigation_map of mana"
    assert not results["image", "mana"]["possible"]
    stage.mission.icu.lose("minnie", "lidar", "no power")
    stage.run(1.0)
    (lost,) = stage.call("catalogue", robot="minnie", type="dem")["products"]
    assert not lost["possible"]
    assert "sensor minnie/lidar is lost: no power" in lost["why_not"]
    assert "pose of minnie" in lost["nearest"]


def test_an_outdated_status_is_skipped(stage: Stage) -> None:
    state, dem = stage.orchestrator._state, ProviderId("mana", "dem")
    state.set_state(dem, "active", changes=5)
    state.set_state(dem, "error", "long ago", changes=4)
    assert dem in state._observed.active
    assert dem not in state._observed.failures
    state.set_alive(dem, alive=False)
    state.set_state(dem, "inactive", changes=1)
    assert state._observed.states[dem] == "inactive", "a new process starts a new count"


@pytest.mark.req("CDFF-SUP-024")
def test_an_error_states_the_request(stage: Stage) -> None:
    error = stage.answer(stage.ask(**{**DEM, "region": "bbox:300,300,310,310", "request": "mine"}))
    assert isinstance(error, UnavailableError)
    assert error.asked is not None
    assert (error.request, error.asked["region"]) == ("mine", "bbox:300,300,310,310")
    wrong = stage.answer(stage.ask(**{**DEM, "priority": "11"}))
    assert wrong.asked["priority"] == "11"
    assert wrong.asked["request"] == wrong.request


def test_a_standing_request_continues_although_the_dpm_stores_its_whole_region(stage: Stage) -> None:
    wish = {
        "type": "dem",
        "robot": "mana",
        "region": "bbox:0,0,2,2",
        "deadline_ms": "60000",
        "min_coverage": "0.01",
    }
    whole = stage.answer(stage.ask(**{**wish, "min_coverage": "0.99", "deadline_ms": "600000"}), 600.0)
    assert isinstance(whole, Reply), whole
    end = stage.answer(stage.ask(**wish, every_s="0"), 70.0)
    assert isinstance(end, Reply), end
    assert end.attachment["kind"] == "end"
    assert end.body()["sent"] > 1
    assert end.body()["asked"]["every_s"] == 0.0


def test_stored_coarser_data_are_delivered_if_no_finer_can_be_produced(
    stage: Stage,
) -> None:
    wish = {"type": "dem", "robot": "mana", "region": "bbox:0,0,2,2", "resolution_m": "0.001"}
    whole = stage.answer(stage.ask(**wish, min_coverage="0.99", deadline_ms="600000"), 600.0)
    assert isinstance(whole, Reply), whole
    received = stage.answer(stage.ask(**wish, explain="true")).body()
    given = stage.answer(stage.ask(**wish))
    assert isinstance(given, Reply), given
    assert given.attachment["delivered"]["differences"]
    assert received["would"] == ("make" if received["plan"] else "serve")


def test_coarser_stored_data_are_replaced_by_a_finer_provider(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    plain = orchestrator_mission.profile()
    cells = {"dem": 1.0, "stereo_dem": 0.5}
    finer = {name: {"parameters": {"resolution_m": m}} for name, m in cells.items()}
    robots = tuple(
        r.model_copy(update={"dfpcs": tuple(e.model_copy(update=finer.get(e.name, {})) for e in r.dfpcs)})
        for r in plain.robots
    )
    monkeypatch.setattr(orchestrator_mission, "profile", lambda: plain.model_copy(update={"robots": robots}))
    monkeypatch.setattr(
        Registry, "default", classmethod(lambda cls: orchestrator_mission.SimulatedRegistry())
    )
    stage, wish = Stage(tmp_path), {"type": "dem", "robot": "mana", "region": "bbox:0,0,2,2"}
    whole = stage.answer(stage.ask(**wish, min_coverage="0.99", deadline_ms="600000"), 600.0)
    assert whole.attachment["delivered"]["resolution_m"] == 1.0
    stage.run(60.0)
    received = stage.answer(stage.ask(**wish, resolution_m="0.5", explain="true")).body()
    assert (received["would"], received["plan"]["provider"]) == ("make", "mana/stereo_dem")
    stage.answer(stage.ask(**wish, resolution_m="0.5"))
    assert "mana/stereo_dem shall provide it" in stage.decisions()


def test_a_product_made_for_the_request_is_not_reported_as_stored_after_replanning(stage: Stage) -> None:
    stage.process("dem").degraded = stage.process("stereo_dem").degraded = True
    given = stage.answer(stage.ask(**DEM, region="bbox:0,0,4,4")).attachment["delivered"]
    assert "the product of mana/dem is DEGRADED" in stage.decisions()
    assert given["assembled"] == {"stored": 0.0, "made": pytest.approx(given["coverage"], abs=1e-4)}


@pytest.mark.req("CDFF-SUP-027")
def test_a_deadline_states_the_progress(stage: Stage) -> None:
    activate(stage)
    error = stage.answer(stage.ask(**{**DEM, "max_age_s": "0", "deadline_ms": "300"}))
    assert isinstance(error, DeadlineError), error
    assert "deadline of 0.3 s" in str(error)
    assert "runs, but provided nothing better in time" in str(error)
