# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of the orchestrator under single failures: new plan, displaced requests, early replies.

The service runs in virtual time on the simulated mission, which has only the faults that a test sets.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Reply
from cdff_common.clock import ManualClock
from cdff_common.errors import (
    CdffError,
    DeadlineError,
    FrameNotFoundError,
    OverloadedError,
    UnavailableError,
)
from cdff_common.interfaces.registry import Registry
from cdff_common.loops import Loops
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator import schedule, service
from services.orchestrator.journal import Journal
from tests.support import orchestrator_mission
from tests.support.orchestrator_stage import DEM, Stage, provider_of


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Stage:
    monkeypatch.setattr(
        Registry, "default", classmethod(lambda cls: orchestrator_mission.SimulatedRegistry())
    )
    return Stage(tmp_path)


def send_and_activate(stage: Stage, **parameters: str) -> list[Any]:
    """Send a request for a DEM; return when its provider is active and has not yet produced anything."""
    received = stage.send(**{**DEM, **parameters})
    dem = stage.process("dem", parameters.get("robot", "mana"))
    assert stage.run_until(lambda: dem.state == "active", 20.0)
    return received


@pytest.mark.req("CDFF-SUP-024")
def test_an_answer_states_request_delivery_and_difference(stage: Stage) -> None:
    reply = stage.final_answer(stage.send(**DEM, region="bbox:0,0,4,4", request="mine"))
    assert provider_of(reply) == "dem"
    asked, delivered = reply.attachment["asked"], reply.attachment["delivered"]
    assert (asked["request"], asked["region"], asked["max_age_s"]) == ("mine", "bbox:0,0,4,4", 4.0)
    assert 0.0 < delivered["coverage"] < 1.0
    assert delivered["differences"] == [f"coverage: {delivered['coverage']:.3f} of the region holds data"]
    assert delivered["assembled"] == {"stored": 0.0, "made": pytest.approx(delivered["coverage"], abs=1e-4)}


@pytest.mark.req("CDFF-SUP-027")
@pytest.mark.parametrize("fault", ["crash", "failure", "no output", "no input", "lost sensor"])
def test_a_failed_provider_is_replaced_by_another_plan(stage: Stage, fault: str) -> None:
    dem = stage.process("dem")
    dem.produces_nothing, dem.receives_nothing = fault == "no output", fault == "no input"
    received = send_and_activate(stage)
    if fault == "lost sensor":
        stage.mission.icu.lose("mana", "lidar", "no power")
    if fault == "crash":
        stage.mission.stop(dem)
    for _ in range(8 if fault == "failure" else 0):
        stage.run_until(lambda: dem.state == "active", 3.0)
        stage.mission.fail(dem)
    assert provider_of(stage.final_answer(received)) == "stereo_dem"


@pytest.mark.req("CDFF-SUP-027")
def test_a_degraded_product_is_delivered_if_the_next_plan_gives_none_better(stage: Stage) -> None:
    stage.process("dem").degraded = stage.process("stereo_dem").degraded = True
    reply = stage.final_answer(send_and_activate(stage))
    assert "the product of mana/dem is DEGRADED" in stage.journal_text()
    assert "status: DEGRADED, see its quality" in reply.attachment["delivered"]["differences"]


POSE = {"type": "pose", "robot": "mana", "max_age_s": "10", "max_sigma_m": "0.1", "deadline_ms": "30000"}


def test_a_bound_on_the_accuracy_selects_the_dfpc_that_may_meet_it(stage: Stage) -> None:
    stage.process("position").sigma_m = 0.5
    assert stage.run_until(lambda: stage.process("position").outputs > 0, 10.0)
    without_bound = {name: value for name, value in POSE.items() if name != "max_sigma_m"}
    assert provider_of(stage.final_answer(stage.send(**without_bound))) == "position"
    start_s = stage.scheduler.now_s
    received = stage.send(**POSE)
    reply = stage.final_answer(received)
    assert provider_of(reply) == "slam"
    delivered = reply.attachment["delivered"]
    assert (delivered["differences"], delivered["sigma_m"]) == ([], pytest.approx(0.01))
    assert received[-1] - start_s < 20.0  # not the deadline
    # Both deliver now; a product that meets the bounds is preferred to a newer one that does not.
    assert provider_of(stage.final_answer(stage.send(**POSE))) == "slam"


def test_a_bound_that_no_dfpc_meets_is_named_at_the_deadline(stage: Stage) -> None:
    stage.process("position").sigma_m = 0.5
    stage.process("slam").sigma_m = 0.3
    received = stage.send(**POSE)
    start_s = stage.scheduler.now_s
    reply = stage.final_answer(received, 35.0)
    assert received[-1] - start_s > 25.0
    differences = reply.attachment["delivered"]["differences"]
    assert differences[1] == "the newest product of no DFPC meets the bounds"
    assert differences[0] in {f"sigma_m: {sigma}, asked at most 0.1" for sigma in (0.3, 0.5)}
    assert reply.attachment["asked"]["max_sigma_m"] == 0.1


def test_an_explanation_states_the_accuracy_of_each_dfpc(stage: Stage) -> None:
    stage.process("position").sigma_m = 0.5
    assert stage.run_until(lambda: stage.process("position").outputs > 0, 10.0)
    body = stage.final_answer(stage.send(**POSE, explain="true")).body()
    assert (body["would"], body["plan"]["provider"]) == ("make", "mana/slam")
    assert body["accuracy"] == [
        {
            "provider": "mana/position",
            "implementation": "Simulated",
            "newest": "sigma 0.5 m and 28.6 deg, covariance none, OK",
            "unmet": ["sigma_m: 0.5, asked at most 0.1"],
        }
    ]


@pytest.mark.usefixtures("stage")
def test_a_request_of_higher_priority_takes_the_cpu_of_a_standing_one_which_resumes_after_it(
    tmp_path: Path,
) -> None:
    # Only stereo_dem can provide elevation: the lidar does not stream in the mode that dem needs.
    profile = orchestrator_mission.profile(dem={"modes": {"lidar": "warm"}})
    profile.robot("mana").limits["cpu_cores"] = 1.5
    stage = Stage(tmp_path / "small", profile)
    stage.process("position").sigma_m = 0.5
    stage.run(4.0)
    stereo = stage.process("stereo_dem")
    low = stage.send(**{**DEM, "priority": "2", "every_s": "1", "deadline_ms": "200000"})
    assert stage.run_until(lambda: stereo.outputs > 1, 30.0)

    equal = stage.final_answer(stage.send(**POSE, priority="2"))
    assert isinstance(equal, UnavailableError) or provider_of(equal) == "position"
    assert stereo.state == "active"
    explained = stage.final_answer(stage.send(**POSE, priority="7", explain="true")).body()
    assert explained["plan"]["takes"] == ["mana/stereo_dem"]

    count = len(low)
    assert provider_of(stage.final_answer(stage.send(**POSE, priority="7"))) == "slam"
    reason = "mana/stereo_dem is stopped: a request of higher priority needs its budgets"
    assert any(reason in str(r.body()) for r in low[count:] if r.attachment["kind"] == "progress")
    assert stage.run_until(lambda: stereo.state == "active", 40.0), "it resumes"
    count = len(low)
    assert stage.run_until(lambda: any(r.attachment["kind"] == "product" for r in low[count:]), 20.0)


def schedule_pose(stage: Stage, after_s: float, duration_s: float, **parameters: str) -> tuple[int, int, str]:
    """Schedule a pose of slam in a window from now; return the window and the id of the request."""
    start_ns = stage.mission.clock.now_ns() + int(after_s * 1e9)
    window = (start_ns, start_ns + int(duration_s * 1e9))
    request = {
        "type": "pose",
        "robot": "mana",
        "max_sigma_m": "0.1",
        "t0": str(window[0]),
        "t1": str(window[1]),
    }
    reply = stage.final_answer(stage.send(**{**request, "request": "later", **parameters}))
    assert reply.attachment["kind"] == "scheduled"
    assert reply.body()["plan"]["provider"] == "mana/slam"
    return *window, "later"


def restart(stage: Stage, pause_s: float = 3.0) -> None:
    """Stop the orchestrator in an orderly way, and start it again after a pause."""
    stage.timing.start(stage.orchestrator.close, "close")
    stage.run(pause_s)
    stage.start_orchestrator()
    stage.run(1.0)


def scheduled_job(stage: Stage, name: str) -> dict[str, Any]:
    (job,) = stage.call("jobs", job=name)["jobs"]
    return dict(job)


def captured_ns(stage: Stage, job: dict[str, Any]) -> list[int]:
    """Return the capture times of those products of a scheduled request that the DPM still holds."""
    known = {x.header.id: x.header.t1_ns for products in stage.mission.products.values() for x in products}
    return [known[product] for product in job["result"]["products"] if product in known]


def test_a_scheduled_request_starts_shortly_before_its_window_and_delivers_in_it(stage: Stage) -> None:
    stage.process("position").sigma_m = 0.5
    stage.run(6.0)
    slam = stage.process("slam")
    t0_ns, t1_ns, name = schedule_pose(stage, 300.0, 60.0)
    stage.run(200.0)
    assert slam.state == "inactive"
    assert scheduled_job(stage, name)["state"] == "scheduled"
    assert stage.run_until(lambda: scheduled_job(stage, name)["state"] == "done", 200.0)
    (t_ns,) = captured_ns(stage, scheduled_job(stage, name))
    assert t0_ns <= t_ns <= t1_ns
    assert stage.run_until(lambda: slam.state == "inactive", 60.0)


def test_a_scheduled_request_continues_after_a_restart_of_the_orchestrator(stage: Stage) -> None:
    stage.process("position").sigma_m = 0.5
    stage.run(6.0)
    t0_ns, t1_ns, name = schedule_pose(stage, 60.0, 100.0, every_s="10")
    schedule_pose(stage, 20.0, 10.0, request="missed")
    restart(stage, pause_s=40.0)
    stage.run(60.0)
    missed = scheduled_job(stage, "missed")
    assert missed["state"] == "missed"
    assert "while no orchestrator was running" in str(missed)
    running = scheduled_job(stage, name)
    assert running["state"] == "running"
    count = len(running["result"]["products"])
    assert count > 0
    restart(stage)
    with pytest.raises(CdffError, match="no job 'missed'"):  # the journal holds its end
        scheduled_job(stage, "missed")
    assert stage.run_until(lambda: scheduled_job(stage, name)["state"] == "done", 150.0)
    done = scheduled_job(stage, name)
    assert len(done["result"]["products"]) > count
    times_ns = captured_ns(stage, done)
    assert times_ns
    assert all(t0_ns <= t_ns <= t1_ns for t_ns in times_ns)


def test_a_scheduled_request_without_a_plan_is_tried_until_the_end_of_its_window(stage: Stage) -> None:
    stage.run(6.0)
    now_ns = stage.mission.clock.now_ns()
    stage.mission.icu.lose("minnie", "lidar", "no power")
    window = {"t0": str(now_ns + 20 * 10**9), "t1": str(now_ns + 100 * 10**9)}
    for name in ("tried", "stopped"):
        stage.final_answer(stage.send(type="dem", robot="minnie", request=name, **window))
    stage.run(50.0)
    tried = scheduled_job(stage, "tried")
    assert tried["state"] == "running"
    assert "sensor minnie/lidar is lost: no power" in tried["reason"]
    stage.call("cancel", job="stopped")
    stage.mission.icu.recover("minnie", "lidar")
    assert stage.run_until(lambda: scheduled_job(stage, "tried")["state"] == "done", 40.0)
    assert scheduled_job(stage, "stopped")["state"] == "cancelled"


def test_a_scheduled_request_that_is_no_longer_valid_ends_as_failed(tmp_path: Path) -> None:
    record = {"request": "old", "parameters": {"type": "nosuch"}, "scope": "mana", "start_ns": 0}
    journal = Journal(tmp_path / "journal.jsonl")
    kept = schedule.Schedule(lambda _: iter(()), lambda _: None, journal, ManualClock(0), Loops())
    kept.recover([record])
    assert kept.listed({"mana"}) == []
    (end,) = journal.records()
    assert (end["action"], end["state"]) == ("end", "failed")
    assert "nosuch" in end["reason"]
    journal.close()


def test_an_unexpected_error_ends_a_scheduled_request(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> Any:
        raise KeyError("simulated")

    monkeypatch.setattr(stage.orchestrator._schedule, "_run_request", fail)
    now_ns = stage.mission.clock.now_ns()
    window = {"t0": str(now_ns + 10**9), "t1": str(now_ns + 10**11)}
    stage.final_answer(stage.send(type="pose", robot="mana", request="broken", **window))
    assert stage.run_until(lambda: scheduled_job(stage, "broken")["state"] == "failed", 30.0)
    assert "KeyError" in scheduled_job(stage, "broken")["reason"]


def test_a_scheduled_request_is_cancelled_or_refused(stage: Stage) -> None:
    stage.process("position").sigma_m = 0.5
    stage.run(6.0)
    *_, name = schedule_pose(stage, 100.0, 10.0)
    again = {"type": "pose", "robot": "mana", "request": name}
    now_ns = stage.mission.clock.now_ns()
    window = {"t0": str(now_ns + 10**11), "t1": str(now_ns + 2 * 10**11)}
    for parameters, text in (
        ({**again, **window}, "is scheduled"),
        ({**again, "t0": "0", "t1": "1000"}, "expected later than now"),
    ):
        error = stage.final_answer(stage.send(**parameters))
        assert isinstance(error, CdffError)
        assert text in str(error)
    for i in range(schedule.MAX_OVERLAPPING - 1):
        stage.final_answer(stage.send(**{**again, **window, "request": f"r{i}"}))
    full = stage.final_answer(stage.send(**{**again, **window, "request": "full"}))
    assert isinstance(full, OverloadedError)
    assert stage.call("cancel", job=name)["state"] == "cancelled"
    assert scheduled_job(stage, name)["state"] == "cancelled"


@pytest.mark.req("CDFF-SUP-027")
def test_a_lost_sensor_without_replacement_is_reported_at_once(stage: Stage) -> None:
    received = send_and_activate(stage, robot="minnie")
    stage.mission.icu.lose("minnie", "lidar", "no power")
    start_s = stage.scheduler.now_s
    error = stage.final_answer(received)
    assert isinstance(error, UnavailableError)
    assert "sensor minnie/lidar is lost: no power" in str(error)
    assert received[-1] - start_s < 2.0
    stage.mission.icu.recover("minnie", "lidar")
    assert provider_of(stage.final_answer(stage.send(**{**DEM, "robot": "minnie"}))) == "dem"


@pytest.mark.req("CDFF-SUP-145")
def test_a_request_of_lower_priority_loses_the_sensor_and_is_refused_with_the_reason(stage: Stage) -> None:
    stage.mission.stop(stage.process("position", "minnie"))
    stage.process("dem", "minnie").produces_nothing = True
    stage.process("slam", "minnie").produces_nothing = True
    stage.run(1.0)
    low = stage.send(**{**DEM, "robot": "minnie", "priority": "3", "deadline_ms": "60000"})
    lidar = SensorId("minnie", "lidar")
    held_mode = stage.orchestrator._state._leases.held_mode
    assert stage.run_until(lambda: held_mode(lidar) == "slow", 20.0)
    stage.final_answer(
        stage.send(type="pose", robot="minnie", max_age_s="1", priority="3", deadline_ms="4000")
    )
    assert held_mode(lidar) == "slow", "a request of equal priority does not displace"
    assert not isinstance(low[-1], float)
    high = stage.send(type="pose", robot="minnie", max_age_s="1", priority="9", deadline_ms="20000")
    error = stage.final_answer(low)
    assert isinstance(error, UnavailableError)
    assert "minnie/lidar is kept in mode fast by another request" in str(error)
    assert "is in mode fast for a request of higher priority" in stage.journal_text()
    stage.process("slam", "minnie").produces_nothing = False
    assert isinstance(stage.final_answer(high), Reply)


def products_in(received: list[Any]) -> list[Reply]:
    """Return the products among the replies to a request."""
    return [r for r in received if isinstance(r, Reply) and r.attachment["kind"] == "product"]


@pytest.mark.req("CDFF-SUP-027")
def test_a_standing_request_resumes_when_its_lost_sensor_is_back(stage: Stage) -> None:
    received = send_and_activate(stage, robot="minnie", every_s="1", deadline_ms="120000", progress="true")
    assert stage.run_until(lambda: len(products_in(received)) >= 2, 20.0)
    stage.mission.icu.lose("minnie", "lidar", "no power")
    stage.run(15.0)
    before = len(products_in(received))
    reasons = [r.body()["reason"] for r in received if r.attachment["kind"] == "progress"]
    assert "sensor minnie/lidar is lost: no power" in reasons[-1]
    assert len(reasons) < 12, "the same reason is reported once"
    stage.mission.icu.recover("minnie", "lidar")
    assert stage.run_until(lambda: len(products_in(received)) >= before + 3, 20.0)
    end = stage.final_answer(received, 120.0)
    assert (end.attachment["kind"], end.body()["sent"]) == ("end", len(products_in(received)))
    assert end.attachment["job"] == end.body()["job"]


@pytest.mark.req("CDFF-SUP-145")
def test_a_standing_request_resumes_when_the_request_that_displaced_it_has_ended(stage: Stage) -> None:
    position = stage.process("position", "minnie")
    stage.process("slam", "minnie").produces_nothing = True
    low = send_and_activate(stage, robot="minnie", priority="3", every_s="1", deadline_ms="120000")
    assert stage.run_until(lambda: len(products_in(low)) >= 2, 20.0)
    stage.mission.stop(position)
    stage.run(1.0)
    high = stage.send(type="pose", robot="minnie", max_age_s="0.1", priority="9", deadline_ms="15000")
    assert isinstance(stage.final_answer(high), CdffError)
    assert "is in mode fast for a request of higher priority" in stage.journal_text()
    stage.mission.start(position)
    before = len(products_in(low))
    assert stage.run_until(lambda: len(products_in(low)) >= before + 3, 30.0)


@pytest.mark.req("CDFF-SUP-027")
def test_a_standing_request_returns_to_a_provider_that_works_again(stage: Stage) -> None:
    dem = stage.process("dem")
    received = send_and_activate(stage, every_s="1", deadline_ms="300000")
    for _ in range(8):
        stage.run_until(lambda: dem.state == "active", 3.0)
        stage.mission.fail(dem)
    assert stage.run_until(lambda: any(provider_of(r) == "stereo_dem" for r in products_in(received)), 30.0)
    failed_s = stage.scheduler.now_s
    assert stage.run_until(lambda: provider_of(products_in(received)[-1]) == "dem", 90.0)
    assert stage.scheduler.now_s - failed_s > 15.0, "not at once"


@pytest.mark.req("CDFF-SUP-142")
def test_an_unobservable_region_is_refused_at_once_with_the_stored_coverage(stage: Stage) -> None:
    start_s = stage.scheduler.now_s
    received = stage.send(**{**DEM, "robot": "any", "region": "bbox:300,300,310,310"})
    error = stage.final_answer(received)
    assert isinstance(error, UnavailableError)
    assert not isinstance(error, DeadlineError)
    assert "the DPM holds 0% of the region" in str(error)
    assert "mana can observe 0% more of it in time" in str(error)
    assert received[-1] - start_s < 1.0


@pytest.mark.req("CDFF-SUP-142")
def test_a_partly_stored_region_is_completed_by_a_provider(stage: Stage) -> None:
    parameters = {**DEM, "region": "bbox:0,0,4,4", "max_age_s": "600", "min_coverage": "0.1"}
    stored = stage.final_answer(stage.send(**parameters)).attachment["delivered"]
    completed = stage.final_answer(
        stage.send(**{**parameters, "min_coverage": "0.5", "deadline_ms": "300000"}), 300.0
    )
    delivered = completed.attachment["delivered"]
    assert delivered["assembled"]["stored"] >= stored["coverage"] - 1e-4
    assert delivered["assembled"]["stored"] + delivered["assembled"]["made"] == pytest.approx(
        delivered["coverage"], abs=1e-3
    )
    assert delivered["coverage"] >= 0.5
    assert delivered["assembled"]["made"] > 0.0


def test_an_unknown_frame_is_not_found_in_requests_and_explanations(stage: Stage) -> None:
    for option in ({}, {"explain": "true"}):
        error = stage.final_answer(stage.send(**DEM, frame="nowhere", **option))
        assert isinstance(error, FrameNotFoundError)
        assert "nowhere" in str(error)


@pytest.mark.req("CDFF-SUP-041")
def test_an_acknowledged_job_survives_a_kill_of_the_orchestrator(stage: Stage) -> None:
    send_and_activate(stage, request="mine", progress="true")
    stage.scheduler.kill(stage.timing)
    stage.mission.buses.clear()
    stage.start_orchestrator()
    stage.run(3.0)
    (job,) = stage.call("jobs", job="mine")["jobs"]
    assert (job["state"], job["reason"]) == ("failed", service.RESTARTED)
    assert job["request"]["type"] == "dem"
    assert job["job"] in {j["job"] for j in stage.call("jobs", robot="any")["jobs"]}
    dem = stage.process("dem")
    assert stage.run_until(lambda: dem.state == "inactive", 60.0), "no request has a lease on it"


@pytest.mark.req("CDFF-SUP-070")
def test_the_catalogue_states_for_each_type_the_providers_or_the_reasons(
    stage: Stage,
) -> None:
    (dem,) = stage.call("catalogue", robot="mana", type="dem")["products"]
    assert dem["possible"]
    assert [provider["dfpc"] for provider in dem["by"]] == ["dem", "stereo_dem"]
    assert all(
        {"cpu_cores", "memory_mb", "ready_s", "resolution_m", "implementation"} <= set(provider)
        for provider in dem["by"]
    )
    products = stage.call("catalogue", robot="any")["products"]
    by_type_and_robot = {(p["type"], p["robot"]): p for p in products}
    assert (
        "no DFPC of minnie provides navigation_map"
        in by_type_and_robot["navigation_map", "minnie"]["why_not"]
    )
    assert by_type_and_robot["navigation_map", "minnie"]["nearest"][0] == "navigation_map of mana"
    assert not by_type_and_robot["image", "mana"]["possible"]
    stage.mission.icu.lose("minnie", "lidar", "no power")
    stage.run(1.0)
    (lost,) = stage.call("catalogue", robot="minnie", type="dem")["products"]
    assert not lost["possible"]
    assert "sensor minnie/lidar is lost: no power" in lost["why_not"]
    assert "pose of minnie" in lost["nearest"]


def test_a_status_that_arrives_out_of_order_is_skipped(stage: Stage) -> None:
    state, dem = stage.orchestrator._state, ProviderId("mana", "dem")
    state.set_state(dem, "active", changes=5)
    state.set_state(dem, "error", "outdated", changes=4)
    assert dem in state._observed.active
    assert dem not in state._observed.failures
    state.set_alive(dem, alive=False)
    state.set_state(dem, "inactive", changes=1)
    assert state._observed.states[dem] == "inactive", (
        "the count of state changes starts at zero in a new process"
    )


@pytest.mark.req("CDFF-SUP-024")
def test_an_error_repeats_the_request(stage: Stage) -> None:
    error = stage.final_answer(stage.send(**{**DEM, "region": "bbox:300,300,310,310", "request": "mine"}))
    assert isinstance(error, UnavailableError)
    assert error.asked is not None
    assert (error.request, error.asked["region"]) == ("mine", "bbox:300,300,310,310")
    invalid = stage.final_answer(stage.send(**{**DEM, "priority": "11"}))
    assert invalid.asked["priority"] == "11"
    assert invalid.asked["request"] == invalid.request


@pytest.mark.slow
def test_a_standing_request_continues_when_the_dpm_has_its_whole_region(stage: Stage) -> None:
    parameters = {
        "type": "dem",
        "robot": "mana",
        "region": "bbox:0,0,2,2",
        "deadline_ms": "60000",
        "min_coverage": "0.01",
    }
    whole = stage.final_answer(
        stage.send(**{**parameters, "min_coverage": "0.99", "deadline_ms": "600000"}), 600.0
    )
    assert isinstance(whole, Reply), whole
    end_reply = stage.final_answer(stage.send(**parameters, every_s="0"), 70.0)
    assert isinstance(end_reply, Reply), end_reply
    assert end_reply.attachment["kind"] == "end"
    assert end_reply.body()["sent"] > 1
    assert end_reply.body()["asked"]["every_s"] == 0.0


def test_stored_coarser_data_are_delivered_if_no_finer_can_be_produced(
    stage: Stage,
) -> None:
    parameters = {"type": "dem", "robot": "mana", "region": "bbox:0,0,2,2", "resolution_m": "0.001"}
    whole = stage.final_answer(stage.send(**parameters, min_coverage="0.99", deadline_ms="600000"), 600.0)
    assert isinstance(whole, Reply), whole
    explanation = stage.final_answer(stage.send(**parameters, explain="true")).body()
    reply = stage.final_answer(stage.send(**parameters))
    assert isinstance(reply, Reply), reply
    assert reply.attachment["delivered"]["differences"]
    assert explanation["would"] == ("make" if explanation["plan"] else "serve")


def test_coarser_stored_data_are_replaced_by_a_finer_provider(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    profile = orchestrator_mission.profile()
    resolutions_m = {"dem": 1.0, "stereo_dem": 0.5}
    updates = {name: {"parameters": {"resolution_m": m}} for name, m in resolutions_m.items()}
    robots = tuple(
        r.model_copy(update={"dfpcs": tuple(e.model_copy(update=updates.get(e.name, {})) for e in r.dfpcs)})
        for r in profile.robots
    )
    monkeypatch.setattr(
        orchestrator_mission, "profile", lambda: profile.model_copy(update={"robots": robots})
    )
    monkeypatch.setattr(
        Registry, "default", classmethod(lambda cls: orchestrator_mission.SimulatedRegistry())
    )
    stage, parameters = Stage(tmp_path), {"type": "dem", "robot": "mana", "region": "bbox:0,0,2,2"}
    whole = stage.final_answer(stage.send(**parameters, min_coverage="0.99", deadline_ms="600000"), 600.0)
    assert whole.attachment["delivered"]["resolution_m"] == 1.0
    stage.run(60.0)
    explanation = stage.final_answer(stage.send(**parameters, resolution_m="0.5", explain="true")).body()
    assert (explanation["would"], explanation["plan"]["provider"]) == ("make", "mana/stereo_dem")
    stage.final_answer(stage.send(**parameters, resolution_m="0.5"))
    assert "mana/stereo_dem shall provide it" in stage.journal_text()


def test_a_product_made_for_the_request_is_not_reported_as_stored_after_replanning(stage: Stage) -> None:
    stage.process("dem").degraded = stage.process("stereo_dem").degraded = True
    delivered = stage.final_answer(stage.send(**DEM, region="bbox:0,0,4,4")).attachment["delivered"]
    assert "the product of mana/dem is DEGRADED" in stage.journal_text()
    assert delivered["assembled"] == {"stored": 0.0, "made": pytest.approx(delivered["coverage"], abs=1e-4)}


@pytest.mark.req("CDFF-SUP-027")
def test_an_error_at_the_deadline_states_the_progress(stage: Stage) -> None:
    send_and_activate(stage)
    error = stage.final_answer(stage.send(**{**DEM, "max_age_s": "0", "deadline_ms": "300"}))
    assert isinstance(error, DeadlineError), error
    assert "deadline of 0.3 s" in str(error)
    assert "runs, but provided nothing better in time" in str(error)
