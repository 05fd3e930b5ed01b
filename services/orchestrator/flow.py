# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One request from arrival to its only final answer.

Look into the DPM; deliver what is as asked. Else plan, hold the DFPCs and sensor modes of the plan, and look again at
every change until something is as asked. Of a region that is held in part only the rest is planned for. Before the
deadline the best that meets all that is mandatory is delivered, or an error says what is missing and why.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from cdff_common.bus import Reply
from cdff_common.clock import Clock
from cdff_common.errors import CdffError, DeadlineError, UnavailableError
from cdff_core.orchestration.judge import Judgement
from cdff_core.orchestration.lifecycle import FINAL_STATES, JobState
from cdff_core.orchestration.planner import NoPlan, Plan
from cdff_core.orchestration.request import ProductRequest
from cdff_core.orchestration.world import MakerId
from services.orchestrator.delivery import Delivery, TooOldError
from services.orchestrator.finder import Finder, Found
from services.orchestrator.jobs import Job, JobBook
from services.orchestrator.journal import Journal
from services.orchestrator.planning import Planning
from services.orchestrator.sharing import SharedLooks
from services.orchestrator.state import State
from services.orchestrator.timing import REAL, Timing

#: Kept back from the deadline for translating and sending the answer: this part of it, within so many seconds, but
#: never more than half of it.
_MARGIN_PART, _MARGIN_MIN_S, _MARGIN_MAX_S = 0.2, 0.3, 2.0
#: Of that, the part in which the DPM is not asked any more: encoding and sending.
_SENDING_PART = 0.5
#: A call that ended so shortly before its own limit, seconds, ended because of it.
_OWN_LIMIT_S = 0.05
#: Least time between two looks into the DPM, and longest wait without any change, seconds.
_LOOK_EVERY_S, _IDLE_S = 0.1, 1.0
#: Reasons for leaving earlier plans that the final answer tells.
_REMEMBERED = 4
#: A DFPC of a plan that failed this often in a row is planned around.
_FAILURES = 3


@dataclass(slots=True)
class _Progress:
    """What a job has come to so far."""

    plan: Plan | None = None
    excluded: set[MakerId] = field(default_factory=set)
    failures: dict[str, int] = field(default_factory=dict)
    past: dict[str, None] = field(default_factory=dict)
    held: float | None = None
    better_since_ns: int | None = None
    best: tuple[Found, Judgement] | None = None
    why: str = ""
    dpm_error: str = ""
    impossible: str = ""
    started_ns: int = 0
    inserted: int = -1
    looked_s: float = 0.0
    told: str = ""


class Flow:
    """Runs jobs; one call of ``run`` for each, in the thread that serves its query."""

    def __init__(
        self,
        state: State,
        finder: Finder,
        planning: Planning,
        delivery: Delivery,
        book: JobBook,
        journal: Journal,
        clock: Clock,
        timing: Timing = REAL,
    ) -> None:
        self._state = state
        self._finder = finder
        self._delivery = delivery
        self._book = book
        self._journal = journal
        self._clock = clock
        self._timing = timing
        self._shared = SharedLooks(clock, timing)
        self._planning = planning

    def run(self, request: ProductRequest) -> Iterator[Reply]:
        """Yield progress, then the final reply; raises the typed error that is the final answer otherwise."""
        try:
            job = self._book.open(request)
        except CdffError as error:
            error.request, error.asked = request.id, request.describe()
            raise
        try:
            yield from self._tell(job)
            self._book.move(job, JobState.LOOKING)
            progress = _Progress(started_ns=self._clock.now_ns())
            with self._shared.joined(request):
                yield from (self._serve if request.every_s is None else self._stand)(job, progress)
        except CdffError as error:
            cancelled = job.cancelled.is_set() and job.retry_after_s is None
            state = JobState.CANCELLED if cancelled else JobState.FAILED
            self._book.move(job, state, str(error), error=type(error).__name__)
            error.request, error.asked = request.id, request.describe()
            raise
        finally:
            if job.state not in FINAL_STATES:  # the requester went away, or a bug
                self._book.move(job, JobState.FAILED, "the answer could not be sent")
            if job.plan is not None:
                self._journal.append("lease", action="release", holder=job.id, makers=[])
                self._state.release(job.id)

    def _serve(self, job: Job, p: _Progress) -> Iterator[Reply]:
        request = job.request
        margin_s = self._margin_s(job)
        robots = self._planning.robots(request)
        self._planning.check_frames(request, robots, job.deadline_s - margin_s)
        seen = -1
        while True:
            job.check_cancelled()
            looked_s = self._timing.now_s()
            seen_now = self._state.version
            self._look_if_new(job, robots, p)
            if self._is_enough(job, robots, p):
                reply = self._deliver(job, p)
                if reply is not None:
                    yield reply
                    return
            if job.remaining_s() <= margin_s:
                yield self._last_word(job, p)
                return
            moved = self._advance(job, robots, p)
            if p.impossible:
                yield self._last_word(job, p)
                return
            if moved:
                yield from self._tell(job, p)
            seen = max(seen, seen_now)
            wait_s = min(_IDLE_S, job.remaining_s() - margin_s)
            seen = self._state.wait(seen, wait_s)
            pause_s = min(_LOOK_EVERY_S - (self._timing.now_s() - looked_s), job.remaining_s() - margin_s)
            if pause_s > 0:
                job.cancelled.wait(pause_s)

    def _stand(self, job: Job, p: _Progress) -> Iterator[Reply]:
        """Each newer product, not more often than asked, until the lease runs out; what makes it is held until then."""
        robots = self._planning.robots(job.request)
        self._planning.check_frames(job.request, robots, job.deadline_s - self._margin_s(job))
        every_s, sent, sent_s, sent_t1_ns = job.request.every_s or 0.0, 0, float("-inf"), -1
        seen = -1
        while job.remaining_s() > 0.0:
            job.check_cancelled()
            looked_s, seen_now = self._timing.now_s(), self._state.version
            self._look_if_new(job, robots, p)
            due_s = sent_s + every_s
            if due_s <= looked_s and p.best is not None and p.best[1].acceptable:
                t1_ns = p.best[0].candidate.t1_ns
                reply = self._reply(job, p) if t1_ns > sent_t1_ns else None
                if reply is not None:
                    yield replace(reply, attachment={**reply.attachment, "final": False})
                    sent, sent_s, sent_t1_ns = sent + 1, looked_s, t1_ns
            if self._advance(job, robots, p):
                yield from self._tell(job, p)
            if p.impossible:
                raise UnavailableError(
                    f"no newer {job.request.product} of {job.request.robot} can be made: {p.impossible}"
                )
            seen = max(seen, seen_now)
            until_s = due_s if looked_s < due_s else looked_s + _IDLE_S
            seen = self._state.wait(seen, min(_IDLE_S, until_s - self._timing.now_s(), job.remaining_s()))
            pause_s = min(_LOOK_EVERY_S - (self._timing.now_s() - looked_s), job.remaining_s())
            if pause_s > 0:
                job.cancelled.wait(pause_s)
        if not sent:
            yield self._last_word(job, p)
            return
        self._book.move(job, JobState.DELIVERING)
        self._book.move(job, JobState.DONE, "its lease was not renewed", result={"kind": "end", "sent": sent})
        body = {"job": job.id, "request": job.request.id, "sent": sent, "reason": job.reason}
        body |= {"asked": job.request.describe()}
        yield Reply.of(body, kind="end", job=job.id, final=True)

    # -- steps ------------------------------------------------------------------------------------------------------

    @staticmethod
    def _margin_s(job: Job) -> float:
        asked_s = job.request.deadline_s
        return min(max(_MARGIN_PART * asked_s, _MARGIN_MIN_S), _MARGIN_MAX_S, 0.5 * asked_s)

    def _ask_until_s(self, job: Job) -> float:
        """Until when the DPM may be asked for what the answer needs, monotonic seconds."""
        return job.deadline_s - _SENDING_PART * self._margin_s(job)

    def _look_if_new(self, job: Job, robots: Sequence[str], p: _Progress) -> None:
        """Look when something that matters was inserted, else now and then: an event may be lost."""
        matter = {job.request.product} | ({"pose"} if job.request.region and job.request.region.near_frame else set())
        inserted, now_s = self._state.inserted(matter), self._timing.now_s()
        if p.looked_s and inserted == p.inserted and now_s - p.looked_s < _IDLE_S:
            return
        fresh_s = _IDLE_S if p.looked_s else _LOOK_EVERY_S
        p.inserted, p.looked_s = inserted, now_s
        self._look(job, robots, p, fresh_s)

    def _look(self, job: Job, robots: Sequence[str], p: _Progress, fresh_s: float) -> None:
        """Look into the DPM; one that is away now may be back before the deadline."""
        until_s = job.deadline_s - self._margin_s(job)
        try:
            p.best, p.why = self._shared.find(
                job.request, lambda: self._finder.find(job.request, robots, until_s), p.inserted, fresh_s, until_s
            )
            p.dpm_error = ""
        except DeadlineError as error:
            # Where our own time was up, that says nothing of the DPM.
            if self._timing.now_s() < until_s - _OWN_LIMIT_S:
                p.dpm_error = f"the DPM: {error}"
        except UnavailableError as error:
            p.dpm_error = f"the DPM: {error}"

    def _is_enough(self, job: Job, robots: Sequence[str], p: _Progress) -> bool:
        """Whether what was found is to be delivered now: as asked, or made for the plan and nothing better comes.

        Where what the plan made is DEGRADED, another way is tried once if there is one.
        """
        if p.best is None or not p.best[1].acceptable:
            return False
        candidate, judgement = p.best[0].candidate, p.best[1]
        made_since = p.plan is not None and candidate.t1_ns > p.started_ns
        if p.plan is not None and candidate.status == "DEGRADED" and made_since and p.better_since_ns is None:
            p.better_since_ns = 0
            without = frozenset({*p.excluded, p.plan.maker})
            better = self._best_plan(job, robots, p, without)
            if isinstance(better, Plan):
                p.better_since_ns = self._clock.now_ns()
                p.excluded |= {p.plan.maker}
                reason = f"what {p.plan.maker} made is DEGRADED"
                self._book.move(job, JobState.PLANNING, reason)
                self._adopt(job, p, better)
                return False
        if candidate.status == "DEGRADED" and p.better_since_ns is not None and candidate.t1_ns <= p.better_since_ns:
            return False  # it is kept as the last word
        return judgement.satisfies or made_since

    def _advance(self, job: Job, robots: Sequence[str], p: _Progress) -> bool:
        """Plan, plan around what fails, follow the plan's start; tells whether the job's state or reason changed."""
        if p.plan is not None:
            reasons = self._troubles(job, robots, p)
            if reasons:
                p.plan, p.past = None, dict.fromkeys([*p.past, *reasons][-_REMEMBERED:])
                self._book.move(job, JobState.PLANNING, "; ".join(reasons))
        if p.plan is None:
            return self._make_plan(job, robots, p)
        progress = self._state.progress(p.plan.order, p.plan.modes)
        missing = [*progress["modes_missing"], *progress["missing"]]
        state = JobState.PREPARING if missing else JobState.WAITING
        reason = "starting " + ", ".join(missing) if missing else (p.why or "for the product")
        if not missing and progress["silent"]:
            reason = "; ".join(progress["silent"].values())
        if p.dpm_error:
            reason = p.dpm_error
        if (state, reason) == (job.state, job.reason):
            return False
        if state is not job.state:
            self._book.move(job, state, reason)
            return True
        job.reason = reason
        return reason != p.told and bool(missing or p.dpm_error or progress["silent"])

    def _troubles(self, job: Job, robots: Sequence[str], p: _Progress) -> list[str]:
        """Why the plan has to be made anew; empty where it is well, or nothing else could be done."""
        assert p.plan is not None
        progress = self._state.progress(p.plan.order, p.plan.modes)
        taken = self._state.displaced(job.id)
        if taken:
            self._journal.append("decision", job=job.id, lost_modes=taken)
        failures = progress["failures"]
        counts = {m: failures.get(str(m), (0, ""))[0] for m in p.plan.order}
        # What failed before this plan is held against a DFPC only once it fails again.
        broken = {m for m, n in counts.items() if n >= _FAILURES and n > p.failures.get(str(m), 0)}
        reasons = [*taken, *progress["lost"].values(), *(failures[str(m)][1] for m in sorted(broken))]
        p.excluded |= broken
        for sensor in map(str, p.plan.modes):
            count, why = failures.get(sensor, (0, ""))
            if count > p.failures.get(sensor, 0) and job.state is JobState.PREPARING:
                reasons.append(why)
            p.failures[sensor] = count
        silent = {m for m in p.plan.order if str(m) in progress["silent"]}
        if silent and not reasons:
            # It may begin to speak again: it is left only where there is another way.
            if isinstance(self._best_plan(job, robots, p, frozenset(p.excluded | silent)), NoPlan):
                return []
            p.excluded |= silent
            reasons += progress["silent"].values()
        return list(dict.fromkeys(reasons))

    def _make_plan(self, job: Job, robots: Sequence[str], p: _Progress) -> bool:
        if job.state is JobState.LOOKING:
            self._book.move(job, JobState.PLANNING, p.dpm_error or p.why)
        chosen = self._best_plan(job, robots, p, frozenset(p.excluded))
        t_ns = job.request.t_ns
        if t_ns is not None and job.request.product != "pose" and t_ns < p.started_ns:
            chosen = NoPlan((f"{p.why or 'there is none'}; t={t_ns} is past: nothing more can be made for it",))
        if isinstance(chosen, NoPlan):
            p.impossible = chosen.text
            self._journal.append("decision", job=job.id, no_plan=chosen.text)
            return False
        self._adopt(job, p, chosen)
        return True

    def _adopt(self, job: Job, p: _Progress, chosen: Plan) -> None:
        """Hold what a plan needs, in place of what the job held."""
        self._state.hold(job.id, chosen, job.request.priority)
        self._journal.append("lease", action="acquire", holder=job.id, makers=[str(m) for m in chosen.order])
        p.plan = chosen
        failures = self._state.progress(chosen.order, chosen.modes)["failures"]
        p.failures = {what: count for what, (count, _) in failures.items()}
        whose = ", ".join(sorted({str(m) for m in chosen.order if job.request.product in self._state.products_of(m)}))
        rest = "" if p.held is None else f"; the DPM held {p.held:.0%} of the region"
        self._book.move(job, JobState.PREPARING, f"{whose or chosen.maker} is to make it{rest}", plan=chosen.describe())

    def _best_plan(self, job: Job, robots: Sequence[str], p: _Progress, exclude: frozenset[MakerId]) -> Plan | NoPlan:
        """The plan to follow now; remembers how much of the region was held when the job first planned."""
        # What a standing request waits for is newer than all that is held.
        standing = job.request.every_s is not None
        found = None if p.best is None or standing else p.best[0]
        until_s = job.deadline_s - self._margin_s(job)
        chosen, covered = self._planning.best(job.request, robots, found, exclude, until_s, job.remaining_s())
        if job.plan is None:  # later on, what is held has been made for it
            p.held = None if not covered or standing else 0.0 if found is None else found.candidate.coverage or 0.0
        return chosen

    def _last_word(self, job: Job, p: _Progress) -> Reply:
        """The best that is acceptable, else the error that says why there is none."""
        if p.best is not None and p.best[1].acceptable:
            reply = self._deliver(job, p)
            if reply is not None:
                return reply
        reasons = [r for r in (p.impossible, p.dpm_error, p.why) if r]
        if p.plan is not None:
            progress = self._state.progress(p.plan.order, p.plan.modes)
            reasons += [*progress["silent"].values(), *progress["lost"].values()]
            if progress["dead"]:
                reasons.append(f"not there: {', '.join(progress['dead'])}")
            elif progress["modes_missing"] or progress["missing"]:
                reasons.append(f"not started: {', '.join([*progress['modes_missing'], *progress['missing']])}")
            reasons += [reason for _, reason in progress["failures"].values()]
            if not (progress["silent"] or progress["missing"] or progress["modes_missing"]):
                reasons.append(f"{p.plan.maker} runs, but made nothing better in time")
        reasons += p.past
        text = "; ".join(dict.fromkeys(reasons)) or "nothing was made in time"
        what = f"no {job.request.product} of {job.request.robot} as asked: {text}"
        if p.impossible:
            raise UnavailableError(what)
        what += f" (deadline of {job.request.deadline_s:g} s)"
        raise (UnavailableError if p.dpm_error or self._is_uncovered(job.request, p) else DeadlineError)(what)

    @staticmethod
    def _is_uncovered(request: ProductRequest, p: _Progress) -> bool:
        """Whether the DPM holds too little of the region, or nothing."""
        if p.best is not None:
            return any("coverage" in m for m in p.best[1].missing)
        return bool(request.region is not None and p.why)

    def _reply(self, job: Job, p: _Progress) -> Reply | None:
        """The best as it was asked for; None where it has become too old since it was found."""
        assert p.best is not None
        try:
            held = None if p.plan is None else p.held
            return self._delivery.reply(job.id, job.request, p.best[0], self._ask_until_s(job), held)
        except TooOldError as error:
            p.best, p.why = (p.best[0], Judgement(missing=(str(error),))), str(error)
            return None

    def _deliver(self, job: Job, p: _Progress) -> Reply | None:
        """The final reply; None, and on with the search, where what was found has become too old since."""
        self._book.move(job, JobState.DELIVERING)
        reply = self._reply(job, p)
        if reply is None:
            self._book.move(job, JobState.WAITING, p.why)
            return None
        result = {
            "kind": reply.attachment["kind"],
            "id": reply.attachment["id"],
            "delivered": reply.attachment["delivered"],
        }
        self._book.move(job, JobState.DONE, result=result)
        return reply

    def _tell(self, job: Job, p: _Progress | None = None) -> Sequence[Reply]:
        """A progress reply, where it was asked for."""
        if p is not None:
            p.told = job.reason
        body = {
            "job": job.id,
            "request": job.request.id,
            "state": str(job.state),
            "reason": job.reason,
            "remaining_s": round(job.remaining_s(), 3),
            "plan": job.plan,
        }
        return [Reply.of(body, kind="progress", job=job.id, final=False)] if job.request.progress else []
