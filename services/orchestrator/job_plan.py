# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Plan of a job: selection, lease, supervision and replacement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from cdff_common import tracing
from cdff_common.clock import Clock
from cdff_core.orchestration.acceptance import Assessment
from cdff_core.orchestration.lifecycle import JobState
from cdff_core.orchestration.planner import NoPlan, Plan
from cdff_core.orchestration.world import ProviderId
from services.orchestrator.delegations import Delegations
from services.orchestrator.exclusions import Exclusions
from services.orchestrator.jobs import Job, JobRegistry
from services.orchestrator.journal import Journal
from services.orchestrator.plan_progress import PlanProgress
from services.orchestrator.planning import RequestPlanner
from services.orchestrator.product_finder import ProductMatch
from services.orchestrator.state import SystemState

#: Largest number of reasons for abandoned plans in the final reply.
_MAX_ABANDONED_REASONS = 4
#: Time between two attempts to plan a standing request for which no plan is possible, seconds.
_ATTEMPT_S = 1.0
#: Consecutive failures after which a DFPC is excluded.
_FAILURES = 3


@dataclass(slots=True, eq=False)
class JobPlan:
    """The current plan of a job, and the providers excluded after failures.

    A plan of a standing request that fails is replaced as soon as another one is possible. A provider that
    failed is used again after a time.

    Attributes
    ----------
    plan : Plan or None
    impossible : str
        Reason why no plan exists; empty otherwise.
    held_fraction : float or None
        Fraction of the region that the DPM held at the first plan; None without a region.
    abandoned_plan_reasons : tuple of str
        Reasons for abandoned plans.
    """

    job: Job
    robots: Sequence[str]
    query_until_s: float
    state: SystemState
    planner: RequestPlanner
    jobs: JobRegistry
    journal: Journal
    clock: Clock
    delegations: Delegations | None = None
    plan: Plan | None = None
    impossible: str = ""
    held_fraction: float | None = None
    abandoned_plan_reasons: tuple[str, ...] = ()
    _started_ns: int = field(init=False)
    _excluded: Exclusions = field(init=False)
    _previous_failures: dict[str, int] = field(default_factory=dict)
    _alternative_tried: bool = False
    _next_attempt_s: float = float("-inf")
    _alternative_since_ns: int | None = None

    def __post_init__(self) -> None:
        self._started_ns = self.clock.now_ns()
        self._excluded = Exclusions(is_final=not self.is_standing)

    @property
    def is_standing(self) -> bool:
        """True for a standing request, which outlasts failures of its providers."""
        return self.job.request.every_s is not None

    @property
    def progress(self) -> PlanProgress | None:
        """Progress of the current plan."""
        return None if self.plan is None else self.state.progress(self.plan, self.job.id)

    def has_made(self, match: ProductMatch) -> bool:
        """Return True if a match was captured after the start of a planned job."""
        return self.plan is not None and match.candidate.t1_ns > self._started_ns

    def has_acquired(self, match: ProductMatch) -> bool:
        """Return True if a match was captured by the single acquisitions of the plan."""
        progress = self.progress
        if progress is None or progress.pending:
            return False
        return self.has_made(match) and match.candidate.t1_ns >= progress.acquired_from_ns

    def supersedes(self, match: ProductMatch) -> bool:
        """Return True if an alternative plan was adopted to replace a DEGRADED match."""
        since_ns = self._alternative_since_ns
        degraded = match.candidate.status == "DEGRADED"
        return degraded and since_ns is not None and match.candidate.t1_ns <= since_ns

    def replace_if_insufficient(self, match: ProductMatch, assessment: Assessment) -> None:
        """Adopt an alternative plan, once, if the product of the current plan is DEGRADED or not accurate
        enough.
        """
        if self.plan is None or self._alternative_tried or not self.has_made(match):
            return
        is_degraded = match.candidate.status == "DEGRADED"
        if not is_degraded and not assessment.bounds:
            return
        self._alternative_tried = True
        provider = self.plan.provider
        # Another implementation of the DFPC, now that the accuracy of this one is known, or another DFPC.
        alternative = self._select(match, self._excluded_now)
        is_other = isinstance(alternative, Plan) and not alternative.has_same_root(self.plan)
        if is_degraded or not is_other:
            alternative = self._select(match, self._excluded_now | {provider})
        if isinstance(alternative, Plan) and self._may_be_accurate(alternative):
            self._alternative_since_ns = max(self.clock.now_ns(), match.candidate.t1_ns)
            if alternative.provider != provider:
                self._excluded.add({provider}, self.job.timing.now_s())
            reason = "is DEGRADED" if is_degraded else f"is not accurate enough ({assessment.bounds[0]})"
            self.jobs.move(self.job, JobState.PLANNING, f"the product of {provider} {reason}")
            self._adopt(alternative)

    def _may_be_accurate(self, plan: Plan) -> bool:
        """Return False if the newest product of the provider of a plan misses the bounds."""
        request = self.job.request
        accuracies = self.planner.accuracies(request, self.robots, self.query_until_s)
        accuracy = accuracies.get((plan.provider, plan.root_implementation))
        return accuracy is None or not request.accuracy.unmet(accuracy)

    def follow(self, match: ProductMatch | None) -> PlanProgress | None:
        """Return the progress of the plan; abandon one that lost a sensor or whose providers fail."""
        plan, progress = self.plan, self.progress
        if plan is None or progress is None:
            return None
        reasons = self._failure_reasons(plan, progress, match)
        if not reasons:
            return progress
        self.plan = None
        self.abandoned_plan_reasons = tuple(
            dict.fromkeys([*self.abandoned_plan_reasons, *reasons][-_MAX_ABANDONED_REASONS:])
        )
        self.jobs.move(self.job, JobState.PLANNING, "; ".join(reasons))
        return None

    def return_to_better(self) -> None:
        """Replace the plan if a provider whose exclusion has ended gives a better one."""
        ended = self._excluded.take_ended(self.job.timing.now_s())
        if self.plan is None or not ended:
            return
        selected = self._select(None, self._excluded_now)
        if isinstance(selected, Plan) and selected.order != self.plan.order:
            self.jobs.move(self.job, JobState.PLANNING, f"used again: {', '.join(map(str, sorted(ended)))}")
            self._adopt(selected)

    @property
    def _excluded_now(self) -> frozenset[ProviderId]:
        return self._excluded.at(self.job.timing.now_s())

    def make(self, match: ProductMatch | None, reason: str) -> bool:
        """Select and adopt a plan; return False, with ``impossible`` set, if there is none.

        ``reason`` states why the match is not sufficient.
        """
        request = self.job.request
        if self.impossible and self.job.timing.now_s() < self._next_attempt_s:
            return False
        if self.job.state is JobState.LOOKING:
            self.jobs.move(self.job, JobState.PLANNING, reason)
        selected = self._select(match, self._excluded_now)
        if request.t_ns is not None and request.product != "pose" and request.t_ns < self._started_ns:
            text = f"{reason or 'there is none'}; t={request.t_ns} is past: no product can be made for it"
            selected = NoPlan((text,))
        if isinstance(selected, NoPlan):
            if selected.text != self.impossible:
                self.journal.append("decision", job=self.job.id, no_plan=selected.text)
            self.impossible = selected.text
            self._next_attempt_s = self.job.timing.now_s() + _ATTEMPT_S
            return False
        self.impossible = ""
        self._adopt(selected)
        return True

    def _failure_reasons(self, plan: Plan, progress: PlanProgress, match: ProductMatch | None) -> list[str]:
        """Return why the plan must be replaced, and exclude failing providers; empty if it is kept."""
        if progress.displaced:
            self.journal.append("decision", job=self.job.id, displaced=list(progress.displaced))
        counts = {m: progress.failures.get(str(m), (0, ""))[0] for m in plan.order}
        # Failures before the adoption of the plan count only after a new failure.
        failing = {
            m for m, n in counts.items() if n >= _FAILURES and n > self._previous_failures.get(str(m), 0)
        }
        reasons = [
            *progress.displaced,
            *progress.lost,
            *(progress.failures[str(m)][1] for m in sorted(failing)),
        ]
        self._excluded.add(failing, self.job.timing.now_s())
        for sensor in map(str, plan.modes):
            count, reason = progress.failures.get(sensor, (0, ""))
            if count > self._previous_failures.get(sensor, 0) and self.job.state is JobState.PREPARING:
                reasons.append(reason)
            self._previous_failures[sensor] = count
        if progress.problems and not reasons:
            # The problem may pass: the plan is replaced only if there is an alternative. A standing request
            # prefers less accurate products to none.
            alternative = self._select(match, self._excluded_now | frozenset(progress.problems))
            if isinstance(alternative, Plan) and (self.is_standing or self._may_be_accurate(alternative)):
                self._excluded.add(progress.problems, self.job.timing.now_s())
                reasons += progress.problems.values()
        return list(dict.fromkeys(reasons))

    def _adopt(self, plan: Plan) -> None:
        """Replace the lease of the job by the needs of a plan."""
        job = self.job
        for provider in plan.order:
            tracing.keep(str(provider))
        self.state.hold(job.id, plan, job.request.priority)
        if self.delegations is not None:
            self.delegations.hold(job, plan)
        providers = [str(m) for m in plan.order]
        # A loss of power ends the DFPCs, too.
        self.journal.append("lease", durable=False, action="acquire", holder=job.id, providers=providers)
        self.plan = plan
        failures = self.state.progress(plan, job.id).failures
        self._previous_failures = {subject: count for subject, (count, _) in failures.items()}
        product = job.request.product
        providers = sorted(str(m) for m in plan.order if product in self.state.products_of(m))
        stored = (
            "" if self.held_fraction is None else f"; the DPM held {self.held_fraction:.0%} of the region"
        )
        reason = f"{', '.join(providers) or plan.provider} shall provide it{stored}"
        self.jobs.move(job, JobState.PREPARING, reason, plan=plan.describe())

    def _select(self, match: ProductMatch | None, excluded: frozenset[ProviderId]) -> Plan | NoPlan:
        """Return the best plan without ``excluded``; a standing request ignores the stored ``match``."""
        stored = None if self.is_standing else match
        selected, is_covered = self.planner.best(
            self.job.request,
            self.robots,
            stored,
            excluded,
            self.query_until_s,
            self.job.remaining_s(),
            self.job.id,
        )
        if self.job.plan is None:  # products found later may be those of the plan
            coverage = 0.0 if stored is None else stored.candidate.coverage or 0.0
            self.held_fraction = coverage if is_covered and not self.is_standing else None
        return selected
