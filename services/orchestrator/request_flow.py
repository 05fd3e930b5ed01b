# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Control sequence of a request from its arrival to its final reply.

Query the DPM and deliver a product that meets the request. Otherwise plan, lease the DFPCs and sensor modes
of the plan, and query again at every change. Of a partly covered region only the missing part is planned.
Before the deadline, deliver the best product that meets all mandatory requirements, or an error with the
reasons.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from cdff_common.bus import Pause, Reply
from cdff_common.clock import Clock
from cdff_common.errors import CdffError, DeadlineError, UnavailableError
from cdff_core.orchestration.acceptance import Assessment
from cdff_core.orchestration.lifecycle import FINAL_STATES, JobState
from cdff_core.orchestration.request import ProductRequest
from cdff_core.orchestration.world import ProviderId
from services.orchestrator.delegations import Delegations
from services.orchestrator.job_plan import JobPlan
from services.orchestrator.jobs import Job, JobRegistry
from services.orchestrator.journal import Journal
from services.orchestrator.pacing import Pacing
from services.orchestrator.planning import RequestPlanner
from services.orchestrator.product_finder import ProductFinder, ProductMatch
from services.orchestrator.reply import ReplyBuilder, TooOldError
from services.orchestrator.shared_queries import SharedQueries
from services.orchestrator.state import SystemState
from services.orchestrator.timing import REAL, Timing

#: Margin before the deadline for conversion and transmission: fraction of the deadline, bounds in seconds; at
#: most half of the deadline.
_MARGIN_FRACTION, _MARGIN_MIN_S, _MARGIN_MAX_S = 0.2, 0.3, 2.0
#: Fraction of the margin for encoding and transmission, without queries to the DPM.
_SENDING_FRACTION = 0.5
#: A query that ends less than this before its time limit, seconds, counts as ended by that limit.
_LIMIT_TOLERANCE_S = 0.05
#: Least time between two queries to the DPM, and longest wait without a change, seconds.
_QUERY_PERIOD_S, _IDLE_S = 0.1, 1.0


@dataclass(slots=True)
class _RequestRun:
    """Progress of one request.

    Attributes
    ----------
    margin_s : float
        Time before the deadline that is reserved for the reply.
    best : tuple of ProductMatch and Assessment, or None
        Best product so far.
    unmet : str
        Requirements that it does not meet, or why there is none.
    dpm_error : str
        Error of the last query; empty after a success.
    insertions, queried_s
        Number of relevant insertions at the last query, and its time (monotonic seconds).
    reported : str
        Last reason in a progress reply.
    relevant : frozenset of (str, str)
        Products whose insertion may change the reply: robot, or any, and name.
    """

    job: Job
    robots: Sequence[str]
    margin_s: float
    plan: JobPlan
    best: tuple[ProductMatch, Assessment] | None = None
    unmet: str = ""
    dpm_error: str = ""
    insertions: int = -1
    queried_s: float | None = None
    reported: str = ""
    relevant: frozenset[tuple[str, str]] = field(init=False)

    def __post_init__(self) -> None:
        request = self.job.request
        near = request.region is not None and request.region.near_frame is not None
        self.relevant = frozenset({(request.robot, request.product), *([("any", "pose")] if near else [])})

    @property
    def query_until_s(self) -> float:
        """Limit of queries for products, monotonic seconds."""
        return self.job.deadline_s - self.margin_s

    @property
    def match(self) -> ProductMatch | None:
        """Best product so far."""
        return None if self.best is None else self.best[0]

    @property
    def acceptable(self) -> ProductMatch | None:
        """Best product so far, if it meets all mandatory requirements."""
        if self.best is None or not self.best[1].acceptable:
            return None
        acquires = self.job.request.acquire is not None
        return None if acquires and not self.plan.has_acquired(self.best[0]) else self.best[0]

    @property
    def is_deliverable(self) -> bool:
        """True if the best product shall be delivered now: as requested, or provided by the plan.

        A product that misses bounds on the accuracy is not: until the deadline a better one may follow.
        """
        match = self.acceptable
        if self.best is None or match is None or self.plan.supersedes(match):
            return False
        assessment = self.best[1]
        return assessment.satisfies or (self.plan.has_made(match) and not assessment.bounds)

    @property
    def is_uncovered(self) -> bool:
        """True if the DPM holds too little of the region, or nothing."""
        if self.best is not None:
            return any("coverage" in violation for violation in self.best[1].violations)
        return bool(self.job.request.region is not None and self.unmet)


@dataclass(slots=True, eq=False)
class RequestFlow:
    """Execution of requests; one call of ``run`` for each. A request that waits occupies no thread."""

    state: SystemState
    finder: ProductFinder
    planner: RequestPlanner
    reply_builder: ReplyBuilder
    jobs: JobRegistry
    journal: Journal
    clock: Clock
    timing: Timing = REAL
    delegations: Delegations | None = None
    _shared: SharedQueries = field(init=False)

    def __post_init__(self) -> None:
        self._shared = SharedQueries(self.clock, self.timing)

    def run(self, request: ProductRequest) -> Iterator[Reply | Pause]:
        """Yield progress and pauses, then the final reply.

        If the request fails, raise the error to be sent as the final reply.
        """
        try:
            job = self.jobs.open(request)
        except CdffError as error:
            error.request, error.asked = request.id, request.describe()
            raise
        try:
            yield from self._progress_reply(job)
            self.jobs.move(job, JobState.LOOKING)
            run = self._start(job)
            with self._shared.share(request), self.state.watch(job.changed, run.robots, run.relevant):
                yield from self._serve(run) if request.every_s is None else self._serve_standing(run)
        except CdffError as error:
            cancelled = job.cancelled.is_set() and job.retry_after_s is None and not job.is_stopped
            state = JobState.CANCELLED if cancelled else JobState.FAILED
            self.jobs.move(job, state, str(error), error=type(error).__name__)
            error.request, error.asked = request.id, request.describe()
            raise
        finally:
            if job.state not in FINAL_STATES:  # the client disconnected, or a bug
                self.jobs.move(job, JobState.FAILED, "the reply could not be sent")
            if job.plan is not None:
                self.journal.append("lease", durable=False, action="release", holder=job.id, providers=[])
                self.state.release(job.id)
                if self.delegations is not None:
                    self.delegations.release(job.id)

    def _start(self, job: Job) -> _RequestRun:
        deadline_s = job.request.deadline_s
        margin_s = min(max(_MARGIN_FRACTION * deadline_s, _MARGIN_MIN_S), _MARGIN_MAX_S, 0.5 * deadline_s)
        robots = self.planner.robots(job.request)
        plan = JobPlan(
            job,
            robots,
            job.deadline_s - margin_s,
            state=self.state,
            planner=self.planner,
            jobs=self.jobs,
            journal=self.journal,
            clock=self.clock,
            delegations=self.delegations,
        )
        return _RequestRun(job, robots, margin_s, plan)

    def _serve(self, run: _RequestRun) -> Iterator[Reply | Pause]:
        """Yield progress, then one product."""
        job = run.job
        self.planner.check_frames(job.request, run.robots, run.query_until_s)
        while True:
            job.changed.clear()
            job.check_cancelled()
            cycle_start_s = self.timing.now_s()
            yield from self._query_if_changed(run)
            if run.best is not None and run.best[1].acceptable:
                run.plan.replace_if_insufficient(*run.best)
            if run.is_deliverable:
                reply = self._deliver(run)
                if reply is not None:
                    yield reply
                    return
            if job.remaining_s() <= run.margin_s:
                yield self._final_reply(run)
                return
            has_changed = self._follow_plan(run)
            if run.plan.impossible:
                yield self._final_reply(run)
                return
            if has_changed:
                yield from self._progress_reply(job, run)
            yield from self._pauses(job, cycle_start_s, _IDLE_S, run.margin_s)

    def _serve_standing(self, run: _RequestRun) -> Iterator[Reply | Pause]:
        """Yield newer products, see ``pacing``, until the lease of the request expires.

        While no plan is possible, the request waits for one, if it has had one.
        """
        job = run.job
        self.planner.check_frames(job.request, run.robots, run.query_until_s)
        pacing = Pacing(job.request.every_s or 0.0)
        while job.remaining_s() > 0.0:
            job.changed.clear()
            job.check_cancelled()
            cycle_start_s = self.timing.now_s()
            yield from self._query_if_changed(run)
            match = run.acceptable
            if match is not None and pacing.is_due(match.candidate.t1_ns, cycle_start_s):
                reply = self._reply(run)
                if reply is not None:
                    yield replace(reply, attachment={**reply.attachment, "final": False})
                    pacing.add(match.candidate.t1_ns, cycle_start_s)
            run.plan.return_to_better()
            if self._follow_plan(run):
                yield from self._progress_reply(job, run)
            if run.plan.impossible:
                product = f"{job.request.product} of {job.request.robot}"
                ended = "".join(f"; {text}" for text in run.plan.abandoned_plan_reasons[-1:])
                reason = f"no newer {product} can be made: {run.plan.impossible}{ended}"
                if job.plan is None:  # no plan was ever possible
                    raise UnavailableError(reason)
                if reason != job.reason:
                    job.reason = reason
                    yield from self._progress_reply(job, run)
            early = cycle_start_s < pacing.earliest_s
            next_s = pacing.earliest_s if early else cycle_start_s + _IDLE_S
            yield from self._pauses(job, cycle_start_s, min(_IDLE_S, next_s - self.timing.now_s()), 0.0)
        if not pacing.sent:
            yield self._final_reply(run)
            return
        self.jobs.move(job, JobState.DELIVERING)
        self.jobs.move(
            job, JobState.DONE, "its lease was not renewed", result={"kind": "end", "sent": pacing.sent}
        )
        body = {"job": job.id, "request": job.request.id, "sent": pacing.sent, "reason": job.reason}
        body |= {"asked": job.request.describe()}
        yield Reply.of(body, kind="end", job=job.id, final=True)

    # -- steps

    def _pauses(self, job: Job, cycle_start_s: float, max_wait_s: float, margin_s: float) -> Iterator[Pause]:
        """Pause until a change since the start of the cycle, at most ``max_wait_s``, then until
        ``_QUERY_PERIOD_S`` after ``cycle_start_s``; both end ``margin_s`` before the deadline.
        """
        yield Pause(job.changed, min(max_wait_s, job.remaining_s() - margin_s))
        pause_s = min(_QUERY_PERIOD_S - (self.timing.now_s() - cycle_start_s), job.remaining_s() - margin_s)
        if pause_s > 0:
            yield Pause(job.cancelled, pause_s)

    def _query_if_changed(self, run: _RequestRun) -> Iterator[Pause]:
        """Query after a relevant insertion, otherwise periodically, since an event may be lost."""
        insertions, now_s = self.state.insertions(run.relevant), self.timing.now_s()
        is_first = run.queried_s is None
        if run.queried_s is not None and insertions == run.insertions and now_s - run.queried_s < _IDLE_S:
            return
        run.insertions, run.queried_s = insertions, now_s
        yield from self._query(run, _QUERY_PERIOD_S if is_first else _IDLE_S)

    def _query(self, run: _RequestRun, max_age_s: float) -> Iterator[Pause]:
        """Query the DPM; an unreachable DPM may return before the deadline."""
        until_s = run.query_until_s
        try:
            run.best, run.unmet = yield from self._shared.find(
                run.job.request,
                lambda: self.finder.find(run.job.request, run.robots, until_s),
                run.insertions,
                max_age_s,
                until_s,
            )
            run.dpm_error = ""
        except DeadlineError as error:
            # A query ended by the limit of this request is no error of the DPM.
            if self.timing.now_s() < until_s - _LIMIT_TOLERANCE_S:
                run.dpm_error = f"the DPM: {error}"
        except UnavailableError as error:
            run.dpm_error = f"the DPM: {error}"

    def _follow_plan(self, run: _RequestRun) -> bool:
        """Make, supervise or replace the plan; return True if a progress reply is due."""
        job, plan = run.job, run.plan
        progress = plan.follow(run.match)
        if progress is None:
            return plan.make(run.match, run.dpm_error or run.unmet)
        problems = "; ".join(progress.problems.values())
        state = JobState.PREPARING if progress.pending else JobState.WAITING
        if progress.pending:
            reason = "starting " + ", ".join(progress.pending)
        else:
            reason = problems or run.unmet or "for the product"
        reason = run.dpm_error or reason
        if (state, reason) == (job.state, job.reason):
            return False
        if state is not job.state:
            self.jobs.move(job, state, reason)
            return True
        job.reason = reason
        return reason != run.reported and bool(progress.pending or run.dpm_error or problems)

    def _final_reply(self, run: _RequestRun) -> Reply:
        """Return the best acceptable product, or raise the error with the reasons."""
        if run.acceptable is not None:
            reply = self._deliver(run)
            if reply is not None:
                return reply
        request, plan = run.job.request, run.plan
        reasons = [r for r in (plan.impossible, run.dpm_error, run.unmet) if r]
        progress = plan.progress
        if plan.plan is not None and progress is not None:
            reasons += [*progress.problems.values(), *progress.lost]
            if progress.dead:
                reasons.append(f"not running: {', '.join(progress.dead)}")
            elif progress.pending:
                reasons.append(f"not started: {', '.join(progress.pending)}")
            reasons += [reason for _, reason in progress.failures.values()]
            if not (progress.problems or progress.pending):
                reasons.append(f"{plan.plan.provider} runs, but provided nothing better in time")
        reasons += plan.abandoned_plan_reasons
        text = "; ".join(dict.fromkeys(reasons)) or "no product was made in time"
        message = f"no {request.product} of {request.robot} as asked: {text}"
        if plan.impossible:
            raise UnavailableError(message)
        message += f" (deadline of {request.deadline_s:g} s)"
        raise (UnavailableError if run.dpm_error or run.is_uncovered else DeadlineError)(message)

    def _reply(self, run: _RequestRun) -> Reply | None:
        """Return the reply with the best product; None if it has become too old since the query."""
        assert run.best is not None
        held_fraction = None if run.plan.plan is None else run.plan.held_fraction
        request, until_s = run.job.request, run.job.deadline_s - _SENDING_FRACTION * run.margin_s
        misses = request.every_s is None and request.accuracy.is_set and run.best[1].bounds
        advice = [self.planner.advice(request, run.robots, until_s)] if misses else []
        try:
            return self.reply_builder.reply(run.job.id, request, run.best[0], until_s, held_fraction, advice)
        except TooOldError as error:
            run.best, run.unmet = (run.best[0], Assessment(violations=(str(error),))), str(error)
            return None

    def _deliver(self, run: _RequestRun) -> Reply | None:
        """Return the final reply and end the job; None if the product has become too old."""
        self.jobs.move(run.job, JobState.DELIVERING)
        reply = self._reply(run)
        if reply is None:
            self.jobs.move(run.job, JobState.WAITING, run.unmet)
            return None
        result = {name: reply.attachment[name] for name in ("kind", "id", "delivered")}
        self.jobs.move(run.job, JobState.DONE, result=result)
        self._renew_linger_time(run)
        return reply

    def _renew_linger_time(self, run: _RequestRun) -> None:
        """Keep the DFPC active whose recent product served a request without a plan.

        A client that repeats requests with a largest age would otherwise be served from the DPM until the
        DFPC is deactivated, and then wait for its next activation.
        """
        match, request = run.match, run.job.request
        if run.job.plan is None and match is not None and match.sources and math.isfinite(request.max_age_s):
            dfpc = match.sources[0].producer.partition("/")[0]
            self.state.renew(ProviderId(match.candidate.robot, dfpc))

    def _progress_reply(self, job: Job, run: _RequestRun | None = None) -> Sequence[Reply]:
        """Return a progress reply, if the client asked for progress."""
        if run is not None:
            run.reported = job.reason
        body = {
            "job": job.id,
            "request": job.request.id,
            "state": str(job.state),
            "reason": job.reason,
            "remaining_s": round(job.remaining_s(), 3),
            "plan": job.plan,
        }
        return [Reply.of(body, kind="progress", job=job.id, final=False)] if job.request.progress else []
