# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The book of jobs: one for each request, bounded while open, remembered for a while when done."""

from __future__ import annotations

import threading
import uuid
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cdff_common.clock import wall_ns
from cdff_common.errors import InputError, OverloadedError, ProductNotFoundError, UnavailableError
from cdff_core.orchestration.lifecycle import FINAL_STATES, JobState, next_job_state
from cdff_core.orchestration.request import ProductRequest
from services.orchestrator.journal import Journal
from services.orchestrator.timing import REAL, Timing


@dataclass(slots=True)
class Job:
    """One request on its way.

    Attributes
    ----------
    id : str
        UUID.
    deadline_s : float
        When the final answer is due, monotonic seconds.
    reason : str
        Why it is in its state.
    result : mapping
        Of a job that is done: kind, id, delivered.
    retry_after_s : float or None
        Of a job that gave its place to one of higher priority: when its requester may come back.
    timing : Timing
    cancelled : Event
        Set when somebody cancelled it, or it gave its place away.
    """

    id: str
    request: ProductRequest
    deadline_s: float
    accepted_ns: int
    state: JobState = JobState.RECEIVED
    reason: str = ""
    plan: Mapping[str, Any] | None = None
    result: Mapping[str, Any] | None = None
    retry_after_s: float | None = None
    timing: Timing = REAL
    cancelled: threading.Event = field(init=False)

    def __post_init__(self) -> None:
        self.cancelled = self.timing.event()

    def remaining_s(self) -> float:
        """Seconds until the answer is due."""
        return self.deadline_s - self.timing.now_s()

    def check_cancelled(self) -> None:
        """Raise UnavailableError if somebody cancelled the job, OverloadedError if it gave its place away."""
        if self.retry_after_s is not None:
            raise OverloadedError(
                f"job {self.id} of priority {self.request.priority} made room for one of higher priority",
                retry_after_s=self.retry_after_s,
            )
        if self.cancelled.is_set():
            raise UnavailableError(f"job {self.id} was cancelled")

    def describe(self) -> dict[str, Any]:
        """Plain data for job lists."""
        return {
            "job": self.id,
            "state": str(self.state),
            "reason": self.reason,
            "accepted_ns": self.accepted_ns,
            "remaining_s": None if self.state in FINAL_STATES else round(self.remaining_s(), 3),
            "request": self.request.describe(),
            "plan": self.plan,
            "result": self.result,
        }


class JobBook:
    """All jobs of one orchestrator.

    Parameters
    ----------
    journal : Journal
        Each change of state is written there first.
    capacity : int
        Most jobs open at a time.
    remembered : int
        Finished jobs that are still listed.
    wake : callable, optional
        Wakes the jobs that wait, so that one which has to make room does so at once.
    """

    def __init__(
        self,
        journal: Journal,
        capacity: int,
        remembered: int = 200,
        wake: Callable[[], None] | None = None,
        timing: Timing = REAL,
    ) -> None:
        self._journal = journal
        self._capacity = capacity
        self._remembered = remembered
        self._wake = wake
        self._timing = timing
        self._lock = timing.lock()
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._past: dict[str, Mapping[str, Any]] = {}  # of earlier orchestrators

    def remember(self, ended: Iterable[Mapping[str, Any]]) -> None:
        """Take over what an earlier orchestrator's journal says of jobs that have ended, as ``Job.describe`` has it."""
        with self._lock:
            self._past = {str(job["job"]): job for job in ended}

    def open(self, request: ProductRequest) -> Job:
        """Accept a request; where too many are open, in place of the last one of the lowest priority below its own.

        Raises
        ------
        OverloadedError
            If too many are open and none has a lower priority.
        InputError
            If a request of the same name is open.
        """
        with self._lock:
            running = [j for j in self._jobs.values() if j.state not in FINAL_STATES]
            if any(j.request.id == request.id for j in running):
                raise InputError(f"request={request.id}: a request of that name is open; give each its own")
            displaced = self._make_room(request, [j for j in running if j.retry_after_s is None])
            deadline_s = self._timing.now_s() + request.deadline_s
            job = Job(str(uuid.uuid4()), request, deadline_s, wall_ns(), timing=self._timing)
            self._jobs[job.id] = job
            done = [j.id for j in self._jobs.values() if j.state in FINAL_STATES]
            for old in done[: max(len(done) - self._remembered, 0)]:
                del self._jobs[old]
        self._journal.append(
            "job",
            # Who is told of progress has been told that the job is taken: it has to survive.
            durable=request.progress,
            job=job.id,
            robot=request.robot,
            state=str(job.state),
            request=request.describe(),
        )
        if displaced is not None and self._wake is not None:
            self._journal.append("decision", job=displaced.id, displaced_by=job.id)
            self._wake()
        return job

    def _make_room(self, request: ProductRequest, staying: list[Job]) -> Job | None:
        """The job that has to go for a request, None where there is room; raises OverloadedError."""
        if len(staying) < self._capacity:
            return None
        soonest_s = max(min(j.remaining_s() for j in staying), 0.1)
        lower = [j for j in staying if j.request.priority < request.priority and j.state is not JobState.DELIVERING]
        if not lower:
            raise OverloadedError(
                f"{len(staying)} requests of priority {request.priority} or more are open, which is the most",
                retry_after_s=soonest_s,
            )
        victim = max(lower, key=lambda j: (-j.request.priority, j.accepted_ns))
        victim.retry_after_s = soonest_s
        victim.cancelled.set()
        return victim

    def move(self, job: Job, state: JobState, reason: str = "", **more: Any) -> None:
        """Put a job in another state, on the journal before anybody is told."""
        with self._lock:
            job.state = next_job_state(job.state, state)
            job.reason = reason
            job.plan = more.get("plan", job.plan)
            job.result = more.get("result", job.result)
        self._journal.append(
            "job",
            durable=job.request.progress and state in FINAL_STATES,
            job=job.id,
            robot=job.request.robot,
            state=str(state),
            reason=reason,
            **more,
        )

    def renew(self, job_id: str, lease_s: float) -> Job:
        """Let a standing request go on for ``lease_s`` from now.

        Raises
        ------
        ProductNotFoundError
            If there is no such job, or it has ended.
        InputError
            If it is no standing request.
        """
        job = self.get(job_id)
        if job.request.every_s is None:
            raise InputError(f"job {job.id} is no standing request: its deadline stays")
        with self._lock:
            if job.state in FINAL_STATES:
                raise ProductNotFoundError(f"job {job.id} has ended ({job.state}); ask again")
            job.deadline_s = self._timing.now_s() + lease_s
        return job

    def describe(self, job_id: str) -> dict[str, Any]:
        """Describe a job by its id or its request's, also one of an earlier orchestrator's.

        Raises
        ------
        ProductNotFoundError
            If it never was, or is too long ago.
        """
        try:
            return self.get(job_id).describe()
        except ProductNotFoundError:
            with self._lock:
                for past in reversed(self._past.values()):
                    if job_id in (past["job"], past["request"].get("request")):
                        return dict(past)
            raise

    def get(self, job_id: str) -> Job:
        """Return a job of this orchestrator by its id or its request's; raises ProductNotFoundError."""
        with self._lock:
            for job in reversed(self._jobs.values()):
                if job_id in (job.id, job.request.id):
                    return job
        raise ProductNotFoundError(f"no job {job_id[:64]!r}: it never was, or is too long ago")

    def listed(self, robots: set[str], limit: int) -> list[dict[str, Any]]:
        """The newest jobs for any of ``robots``, newest first."""
        with self._lock:
            chosen = [j for j in reversed(self._jobs.values()) if j.request.robot in robots | {"any"}]
            past = [dict(j) for j in reversed(self._past.values()) if j["request"].get("robot") in robots | {"any"}]
            return [*(j.describe() for j in chosen), *past][:limit]
