# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Plan of a job while its providers fail, its sensors are lost and products of the plan arrive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cdff_common.clock import ManualClock
from cdff_core.orchestration.acceptance import ProductCandidate, assess
from cdff_core.orchestration.accuracy import Accuracy
from cdff_core.orchestration.lifecycle import JobState
from cdff_core.orchestration.planner import NoPlan, Plan
from cdff_core.orchestration.request import parse_request
from cdff_core.orchestration.world import ProviderId, SensorId
from cdff_dev.mission_replay.virtual import Scheduler, VirtualTiming
from services.orchestrator.job_plan import JobPlan
from services.orchestrator.jobs import JobRegistry
from services.orchestrator.journal import Journal
from services.orchestrator.plan_progress import PlanProgress
from services.orchestrator.product_finder import ProductMatch
from services.orchestrator.timing import REAL, Timing

S = 1_000_000_000
FIRST, SECOND = ProviderId("mana", "first"), ProviderId("mana", "second")
LIDAR = SensorId("mana", "lidar")
NO_PROGRESS = PlanProgress((), (), (), (), (), {}, {})


def plan_of(provider: ProviderId) -> Plan:
    return Plan(provider, "out", (provider,), {LIDAR: "on"}, 1.0)


def match(t1_ns: int, status: str = "OK", coverage: float | None = None) -> ProductMatch:
    candidate = ProductCandidate("id", "mana", t1_ns, t1_ns, status=status, coverage=coverage)
    return ProductMatch(candidate, (), None, "site", "", is_unmodified=True)


def replace_if_insufficient(plan: JobPlan, product: ProductMatch) -> None:
    """Let a plan assess a product."""
    plan.replace_if_insufficient(product, assess(product.candidate, plan.job.request, 104 * S))


class State:
    """State double with a scripted progress."""

    def __init__(self) -> None:
        self.current, self.held = NO_PROGRESS, []

    def progress(self, plan: Plan, holder: str) -> PlanProgress:
        return self.current

    def hold(self, job: str, plan: Plan, priority: int) -> None:
        self.held.append((plan.provider, priority))

    def products_of(self, provider: ProviderId) -> set[str]:
        return {"dem"}


class Planner:
    """Planner double: the first provider that is not excluded, or no plan."""

    def __init__(self, is_covered: bool = True, providers: tuple[ProviderId, ...] = (FIRST, SECOND)) -> None:
        self.is_covered, self.providers = is_covered, providers
        self.known: dict[tuple[ProviderId, str], Accuracy] = {}
        self.calls = list[tuple[Any, frozenset[ProviderId]]]()

    def accuracies(self, *_: object) -> dict[tuple[ProviderId, str], Accuracy]:
        return self.known

    def best(
        self, request: object, robots: object, stored: Any, excluded: Any, *_: object
    ) -> tuple[Plan | NoPlan, bool]:
        self.calls.append((stored, excluded))
        remaining = [p for p in self.providers if p not in excluded]
        return (plan_of(remaining[0]) if remaining else NoPlan(("no provider",))), self.is_covered


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    journal = Journal(tmp_path / "journal.jsonl")
    yield journal
    journal.close()


@pytest.fixture
def state() -> State:
    return State()


def job_plan(
    journal: Journal,
    state: State,
    planner: Planner | None = None,
    now_s: int = 100,
    timing: Timing = REAL,
    **parameters: str,
) -> JobPlan:
    jobs = JobRegistry(journal, 4, timing=timing)
    job = jobs.open(parse_request({"type": "dem", "priority": "7", **parameters}, "mana"))
    jobs.move(job, JobState.LOOKING)
    return JobPlan(
        job, ("mana",), 0.0, state=state, planner=planner or Planner(), jobs=jobs, journal=journal,
        clock=ManualClock(now_s * S),
    )  # type: ignore[arg-type]  # fmt: skip


def test_a_plan_is_held_with_the_priority_and_describes_what_the_dpm_holds(
    journal: Journal, state: State
) -> None:
    plan = job_plan(journal, state)
    assert plan.progress is None
    assert plan.make(match(1 * S, coverage=0.25), "too little")
    assert state.held == [(FIRST, 7)]
    assert plan.progress is NO_PROGRESS
    assert (plan.job.state, plan.held_fraction) == (JobState.PREPARING, 0.25)
    assert plan.job.reason == "mana/first shall provide it; the DPM held 25% of the region"
    planning = [r for r in journal.records() if r.get("state") == "planning"]
    assert [r["reason"] for r in planning] == ["too little"]
    (lease,) = (r for r in journal.records() if r["kind"] == "lease")
    assert (lease["action"], lease["providers"]) == ("acquire", ["mana/first"])


def test_without_coverage_nothing_is_stated_about_the_region(journal: Journal, state: State) -> None:
    plan = job_plan(journal, state, Planner(is_covered=False))
    plan.make(match(1 * S, coverage=0.25), "")
    assert plan.held_fraction is None
    assert plan.job.reason == "mana/first shall provide it"


def test_a_standing_request_is_planned_without_the_stored_product(journal: Journal, state: State) -> None:
    planner = Planner()
    plan = job_plan(journal, state, planner, every_s="2")
    plan.make(match(1 * S, coverage=0.25), "")
    assert planner.calls == [(None, frozenset())]
    assert plan.held_fraction is None


def test_a_product_of_the_plan_ends_after_its_start(journal: Journal, state: State) -> None:
    plan = job_plan(journal, state)
    assert not plan.has_made(match(101 * S))
    plan.make(None, "")
    assert [plan.has_made(match(t * S)) for t in (99, 100, 101)] == [False, False, True]


def test_a_past_time_cannot_be_planned_but_the_present_can(journal: Journal, state: State) -> None:
    past = job_plan(journal, state, t=str(100 * S - 1000))
    assert not past.make(None, "there is none of that age")
    assert past.impossible.startswith("there is none of that age; t=99999999000 is past")
    assert state.held == []
    (decision,) = (r for r in journal.records() if r["kind"] == "decision")
    assert (decision["job"], decision["no_plan"]) == (past.job.id, past.impossible)
    assert job_plan(journal, state, t=str(100 * S)).make(None, "")


def test_an_impossible_plan_is_searched_again_after_a_second(journal: Journal, state: State) -> None:
    scheduler, planner = Scheduler(), Planner(providers=())
    plan = job_plan(journal, state, planner, timing=VirtualTiming(scheduler), every_s="2")
    searches = []
    for now_s in (0.0, 0.5, 0.99, 1.0, 1.5, 2.0):
        scheduler.now_s = now_s
        assert not plan.make(None, "")
        searches.append(len(planner.calls))
    assert searches == [1, 1, 1, 2, 2, 3]
    planner.providers = (FIRST,)
    scheduler.now_s = 3.0
    assert plan.make(None, "")
    assert plan.impossible == ""


@pytest.mark.parametrize(("failures", "is_abandoned"), [(2, False), (3, True), (4, True)])
def test_three_consecutive_failures_abandon_the_plan_and_exclude_the_provider(
    journal: Journal, state: State, failures: int, is_abandoned: bool
) -> None:
    plan = job_plan(journal, state)
    plan.make(None, "")
    state.current = replace(NO_PROGRESS, failures={str(FIRST): (failures, "it crashed")})
    plan.follow(None)
    assert (plan.plan is None) == is_abandoned
    assert plan.abandoned_plan_reasons == (("it crashed",) if is_abandoned else ())
    if is_abandoned:
        assert (plan.job.state, plan.job.reason) == (JobState.PLANNING, "it crashed")
        state.current = NO_PROGRESS
        plan.make(None, "")
        assert plan.plan is not None
        assert plan.plan.provider == SECOND


def test_failures_before_the_adoption_count_only_after_a_new_one(journal: Journal, state: State) -> None:
    state.current = replace(NO_PROGRESS, failures={str(FIRST): (5, "old")})
    plan = job_plan(journal, state)
    plan.make(None, "")
    plan.follow(None)
    assert plan.plan is not None
    state.current = replace(NO_PROGRESS, failures={str(FIRST): (6, "new")})
    plan.follow(None)
    assert plan.abandoned_plan_reasons == ("new",)


def test_a_failed_change_of_a_sensor_mode_abandons_the_plan_only_while_preparing(
    journal: Journal, state: State
) -> None:
    plan = job_plan(journal, state)
    plan.make(None, "")
    state.current = replace(NO_PROGRESS, failures={str(LIDAR): (1, "refused")})
    plan.follow(None)
    assert plan.abandoned_plan_reasons == ("refused",)
    state.current = NO_PROGRESS
    plan.make(None, "")
    plan.jobs.move(plan.job, JobState.WAITING)
    state.current = replace(NO_PROGRESS, failures={str(LIDAR): (1, "refused")})
    plan.follow(None)
    assert plan.plan is not None


def test_lost_sensors_and_displaced_modes_abandon_the_plan(journal: Journal, state: State) -> None:
    plan = job_plan(journal, state)
    plan.make(None, "")
    state.current = replace(NO_PROGRESS, displaced=("mode taken",), lost=("lidar lost", "mode taken"))
    plan.follow(None)
    assert plan.abandoned_plan_reasons == ("mode taken", "lidar lost")
    assert {"job": plan.job.id, "displaced": ["mode taken"]}.items() <= next(
        r for r in journal.records() if "displaced" in r
    ).items()


def test_the_last_four_reasons_are_reported(journal: Journal, state: State) -> None:
    plan = job_plan(journal, state)
    for number in range(6):
        state.current = NO_PROGRESS
        plan.make(None, "")
        state.current = replace(NO_PROGRESS, lost=(f"lost {number}",))
        plan.follow(None)
    assert plan.abandoned_plan_reasons == ("lost 2", "lost 3", "lost 4", "lost 5")


def test_a_problem_abandons_the_plan_only_for_an_alternative(journal: Journal, state: State) -> None:
    plan = job_plan(journal, state)
    plan.make(None, "")
    state.current = replace(NO_PROGRESS, problems={FIRST: "no input", SECOND: "no input"})
    plan.follow(None)
    assert plan.plan is not None
    state.current = replace(NO_PROGRESS, problems={FIRST: "no input"})
    plan.follow(None)
    assert plan.abandoned_plan_reasons == ("no input",)
    state.current = NO_PROGRESS
    plan.make(None, "")
    assert plan.plan is not None
    assert plan.plan.provider == SECOND


@pytest.mark.parametrize(
    ("other_sigma_m", "every_s", "is_replaced"),
    [(0.05, None, True), (0.2, None, False), (0.2, "2", True)],
    ids=["an accurate alternative", "an inaccurate alternative", "a standing request"],
)
def test_a_problem_may_pass_so_that_a_plan_is_kept_if_the_alternative_is_not_accurate_enough(
    journal: Journal, state: State, other_sigma_m: float, every_s: str | None, is_replaced: bool
) -> None:
    planner = Planner()
    planner.known[SECOND, ""] = Accuracy(sigma_m=other_sigma_m)
    standing: dict[str, Any] = {} if every_s is None else {"every_s": every_s}
    plan = job_plan(journal, state, planner, max_sigma_m="0.1", **standing)
    plan.make(None, "")
    state.current = replace(NO_PROGRESS, problems={FIRST: "the target is out of reach"})
    plan.follow(None)
    assert (plan.plan is None) == is_replaced


def test_a_degraded_product_of_the_plan_is_replaced_once(journal: Journal, state: State) -> None:
    plan = job_plan(journal, state)
    replace_if_insufficient(plan, match(101 * S, "DEGRADED"))
    plan.make(None, "")
    for other in (match(101 * S), match(100 * S, "DEGRADED")):  # good, or not of this plan
        replace_if_insufficient(plan, other)
        assert state.held == [(FIRST, 7)]
    degraded = match(103 * S, "DEGRADED")
    assert not plan.supersedes(degraded)
    replace_if_insufficient(plan, degraded)
    assert state.held == [(FIRST, 7), (SECOND, 7)]
    assert any(r.get("reason") == "the product of mana/first is DEGRADED" for r in journal.records())
    assert [plan.supersedes(match(t * S, "DEGRADED")) for t in (102, 103, 104)] == [True, True, False]
    assert not plan.supersedes(match(103 * S))
    replace_if_insufficient(plan, match(104 * S, "DEGRADED"))
    assert len(state.held) == 2


def test_a_degraded_product_without_an_alternative_does_not_end_the_plan(
    journal: Journal, state: State
) -> None:
    plan = job_plan(journal, state, Planner(providers=(FIRST,)))
    plan.make(None, "")
    replace_if_insufficient(plan, match(101 * S, "DEGRADED"))
    assert state.held == [(FIRST, 7)]
    assert not plan.supersedes(match(101 * S, "DEGRADED"))


def test_a_degraded_product_keeps_its_plan_if_the_other_is_known_to_be_worse(
    journal: Journal, state: State
) -> None:
    planner = Planner()
    planner.known[SECOND, ""] = Accuracy(sigma_m=80.0)
    plan = job_plan(journal, state, planner, max_sigma_m="0.1")
    plan.make(None, "")
    first = match(101 * S, "DEGRADED")
    inaccurate = replace(first.candidate, accuracy=Accuracy(sigma_m=6.0, status="DEGRADED"))
    replace_if_insufficient(plan, replace(first, candidate=inaccurate))
    assert state.held == [(FIRST, 7)]


@pytest.mark.parametrize(("other_sigma_m", "is_replaced"), [(None, True), (0.05, True), (0.2, False)])
def test_a_product_that_is_not_accurate_enough_is_replaced_unless_the_other_is_known_to_be_no_better(
    journal: Journal, state: State, other_sigma_m: float | None, is_replaced: bool
) -> None:
    planner = Planner()
    if other_sigma_m is not None:
        planner.known[SECOND, ""] = Accuracy(sigma_m=other_sigma_m)
    plan = job_plan(journal, state, planner, max_sigma_m="0.1")
    plan.make(None, "")
    made = match(101 * S)
    for sigma_m in (0.1, 0.3):
        accurate = replace(made.candidate, accuracy=Accuracy(sigma_m=sigma_m))
        replace_if_insufficient(plan, replace(made, candidate=accurate))
        assert (len(state.held) == 2) == (sigma_m > 0.1 and is_replaced)
    reason = "the product of mana/first is not accurate enough (sigma_m: 0.3, asked at most 0.1)"
    assert any(r.get("reason") == reason for r in journal.records()) == is_replaced
