# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Requests that the ground delegates to the orchestrator of a robot: shared, repeated, raised, cancelled."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common.clock import ManualClock
from cdff_common.contract.queries import JobsParameters
from cdff_common.errors import (
    CdffError,
    DeadlineError,
    NoAnswerError,
    OverloadedError,
    RefusedError,
    UnavailableError,
)
from cdff_common.interfaces.profile import load_profile
from cdff_common.loops import Loops
from cdff_core.orchestration.acquisition import Acquisition, AcquisitionParameters
from cdff_core.orchestration.lifecycle import FINAL_STATES
from cdff_core.orchestration.planner import Plan
from cdff_core.orchestration.request import parse_request
from cdff_core.orchestration.world import ProviderId, SensorId
from cdff_dev.mission_replay.virtual import Scheduler, VirtualTiming
from services.orchestrator.delegations import DELEGATED, Delegations, _is_failure
from services.orchestrator.jobs import Job
from services.orchestrator.state import SystemState
from tests.support.recording_bus import Call, RecordingBus

PROFILE = load_profile(Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml")
MAPPER, LIDAR = ProviderId("mana", "digital_elevation_mapping"), SensorId("mana", "lidar")
NOW_NS = 7_000_000_000
PRODUCT = {"kind": "product"}


class Ground:
    """Delegations of a ground whose robot mana has an orchestrator of its own."""

    def __init__(self) -> None:
        self.scheduler = Scheduler()
        self.timing = VirtualTiming(self.scheduler)
        self.jobs_elsewhere: list[dict[str, Any]] = []
        self.cancel_fault: CdffError | None = None
        self.bus: Any = RecordingBus(self.answer)
        self.state = SystemState(PROFILE, self.timing)
        self.state.set_control("mana", controlled=False)
        loops = Loops(self.timing.now_s)
        clock = ManualClock(NOW_NS)
        self.delegations = Delegations(self.bus, self.state, loops, clock, self.timing)
        self.delegations.start()
        self.jobs = 0

    def answer(self, call: Call) -> dict[str, Any] | CdffError | None:
        if call.verb == "jobs":
            p = JobsParameters.parse({name: str(value) for name, value in call.parameters.items()})
            open_jobs = [job for job in self.jobs_elsewhere if job["state"] not in FINAL_STATES]
            return {"jobs": open_jobs if p.state == "open" else self.jobs_elsewhere}
        if call.verb == "cancel":
            return self.cancel_fault or {"job": call.parameters["job"]}
        return None

    def job(self, **parameters: str) -> Job:
        self.jobs += 1
        request = parse_request({"type": "dem", "robot": "mana", **parameters}, "ground")
        deadline_s = self.timing.now_s() + request.deadline_s
        return Job(f"job{self.jobs}", request, deadline_s, 0, timing=self.timing)

    def hold(self, job: Job, **fields: Any) -> Plan:
        plan = Plan(MAPPER, "dem", (MAPPER,), {LIDAR: "scanning"}, 1.0, **fields)
        self.state.hold(job.id, plan, job.request.priority)
        self.delegations.hold(job, plan)
        self.run(0.0)
        return plan

    def run(self, seconds: float) -> None:
        """Let virtual time pass."""
        until_s = self.scheduler.now_s + seconds
        self.scheduler.start(lambda: self.scheduler.sleep(seconds), "test")
        for _ in range(200):
            if not self.scheduler.step() or self.scheduler.now_s > until_s:
                break
            if self.scheduler.now_s >= until_s and not any(t.ready() for t in self.scheduler.tasks):
                break

    def hand_back(self) -> None:
        """End the control of mana by the ground, as ``Control`` does."""
        self.state.set_control("mana", controlled=False)
        self.delegations.update()
        self.run(0.0)

    @property
    def requests(self) -> list[dict[str, Any]]:
        """Parameters of the requests to the robot."""
        return [call.parameters for call in self.bus.of("request")]

    @property
    def cancelled(self) -> list[str]:
        return [call.parameters["job"] for call in self.bus.of("cancel")]


@pytest.fixture
def ground() -> Iterator[Ground]:
    ground = Ground()
    yield ground
    # The ground itself serves the keys of its robots, too: it must not answer its own calls.
    assert all(call.is_elsewhere for call in ground.bus.calls)


def test_equal_jobs_share_a_request_that_is_repeated_while_one_needs_it(ground: Ground) -> None:
    jobs = [ground.job(deadline_ms="8000"), ground.job(deadline_ms="20000")]
    for job in jobs:
        ground.hold(job)
    (sent,) = ground.requests
    assert sent["request"].startswith(DELEGATED)
    assert (sent["robot"], sent["deliver"]) == ("mana", "none")
    ground.bus.end(PRODUCT)
    ground.run(0.5)
    assert len(ground.requests) == 1  # after a pause
    ground.run(1.0)
    assert len(ground.requests) == 2
    for job in jobs:
        ground.delegations.release(job.id)
    ground.run(0.0)
    assert ground.cancelled == [ground.requests[1]["request"]]


def test_a_request_for_a_time_window_is_delegated_when_its_window_is_there(ground: Ground) -> None:
    ground.hold(ground.job(t0=str(NOW_NS), t1=str(2 * NOW_NS)))
    assert "t0" not in ground.requests[0]


def test_the_deadline_of_a_delegated_request_is_within_the_limits(ground: Ground) -> None:
    job = ground.job(deadline_ms="3600000", every_s="1")
    job.deadline_s += 600.0  # the lease was renewed
    ground.hold(job)
    assert ground.requests[0]["deadline_ms"] == 3_600_000
    parse_request(ground.requests[0], "mana")


def test_a_job_of_higher_priority_raises_that_of_the_request(ground: Ground) -> None:
    ground.hold(ground.job(priority="2"))
    ground.hold(ground.job(priority="8"))
    assert [r["priority"] for r in ground.requests] == [2, 8]
    assert ground.cancelled == [ground.requests[0]["request"]]
    ground.hold(ground.job(priority="3"))
    assert len(ground.requests) == 2


@pytest.mark.parametrize(
    ("error", "failures"),
    [
        (RefusedError("no"), 1),
        (UnavailableError("no plan"), 1),
        (UnavailableError("the orchestrator is stopping", 1.0), 0),
        (OverloadedError("too many", 3.0), 0),
        (DeadlineError("late"), 0),
        (NoAnswerError("none"), 0),
    ],
)
def test_only_an_answer_against_the_dfpc_counts_as_its_failure(
    ground: Ground, error: CdffError, failures: int
) -> None:
    job = ground.job(deadline_ms="20000")
    plan = ground.hold(job)
    ground.bus.end(error)
    counted = ground.state.progress(plan, job.id).failures.get(str(MAPPER), (0, ""))
    assert counted[0] == failures
    pause_s = getattr(error, "retry_after_s", None) or 1.0
    ground.run(pause_s - 0.1)
    assert len(ground.requests) == 1
    ground.run(0.2)
    assert len(ground.requests) == 2


def test_a_single_acquisition_is_made_once_for_each_job(ground: Ground) -> None:
    acquisition = Acquisition("one_scan", AcquisitionParameters.parse("now"))
    jobs = [ground.job(acquire="now", deadline_ms="20000") for _ in range(2)]
    plans = [ground.hold(job, acquisitions={LIDAR: acquisition}) for job in jobs]
    assert len(ground.requests) == 2
    ground.bus.end(PRODUCT)
    first, second = (ground.state.progress(plan, job.id) for plan, job in zip(plans, jobs, strict=True))
    assert (first.pending_modes, first.acquired_from_ns) == ((), NOW_NS)
    assert second.pending_modes == (str(LIDAR),)
    ground.run(5.0)
    assert len(ground.requests) == 2
    ground.bus.end(UnavailableError("the lidar is busy"))
    ground.run(1.1)
    assert len(ground.requests) == 3  # what failed is repeated


def test_an_acquisition_that_was_made_is_not_repeated_after_a_take_over(ground: Ground) -> None:
    acquisition = Acquisition("one_scan", AcquisitionParameters.parse("now"))
    ground.hold(ground.job(acquire="now", deadline_ms="20000"), acquisitions={LIDAR: acquisition})
    ground.bus.end(PRODUCT)
    ground.state.set_control("mana", controlled=True)
    ground.delegations.update()
    ground.run(1.0)
    ground.hand_back()
    ground.run(2.0)
    assert len(ground.requests) == 1


def test_a_take_over_cancels_and_a_lost_cancellation_is_repeated(ground: Ground) -> None:
    ground.hold(ground.job(deadline_ms="20000"))
    sent = ground.requests[0]["request"]
    ground.cancel_fault = NoAnswerError("no queryable")
    ground.state.set_control("mana", controlled=True)
    ground.delegations.update()
    ground.run(3.0)
    assert ground.cancelled == [sent]  # the ground owns the robot: its orchestrator is absent
    ground.cancel_fault = None
    ended = {"request": {"request": f"{DELEGATED}ended"}, "state": "done"}
    others = {"request": {"request": "client"}, "state": "waiting"}
    ground.jobs_elsewhere = [{"request": {"request": sent}, "state": "waiting"}, ended, others]
    ground.delegations.follow("mana")  # the token returns before the hand-over
    ground.run(2.0)
    assert ground.cancelled == [sent]
    ground.hand_back()
    assert ground.cancelled == [sent, sent]
    assert len(ground.requests) == 2


def test_requests_of_an_earlier_ground_process_are_cancelled_until_answered(ground: Ground) -> None:
    earlier = {"request": {"request": f"{DELEGATED}earlier"}, "state": "waiting"}
    ground.jobs_elsewhere = [earlier]
    ground.cancel_fault = NoAnswerError("no queryable")
    ground.delegations.follow("mana")
    ground.run(2.5)
    assert len(ground.cancelled) == 3
    ground.cancel_fault = None
    ground.run(5.0)
    assert len(ground.cancelled) == 4


@pytest.mark.parametrize(
    ("error", "is_failure"),
    [
        (UnavailableError("no plan"), True),
        (UnavailableError("later", retry_after_s=1.0), False),
        (DeadlineError("late"), False),
        (NoAnswerError("silent"), False),
    ],
)
def test_a_late_missing_or_deferred_answer_is_no_failure_of_the_dfpcs(
    error: CdffError, is_failure: bool
) -> None:
    assert _is_failure(error) is is_failure
