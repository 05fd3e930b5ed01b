# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registry of jobs, one for each request: limited in number while open, listed for a while after the end."""

from __future__ import annotations

import uuid
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cdff_common.bus import Signal
from cdff_common.clock import wall_ns
from cdff_common.errors import InputError, OverloadedError, ProductNotFoundError, UnavailableError
from cdff_core.orchestration.lifecycle import FINAL_STATES, JobState, next_job_state
from cdff_core.orchestration.request import ProductRequest
from services.orchestrator.journal import Journal
from services.orchestrator.timing import REAL, Timing

#: Time after which a new orchestrator may be running, and period of the check for ended jobs, seconds.
_RESTART_S, _STOP_PERIOD_S = 1.0, 0.02


def _stopping_error() -> UnavailableError:
    return UnavailableError("the orchestrator is stopping; repeat the request", _RESTART_S)


@dataclass(slots=True)
class Job:
    """A request in execution.

    Attributes
    ----------
    id : str
        UUID.
    deadline_s : float
        When the final reply is due, monotonic seconds.
    accepted_ns : int
        Wall time.
    opened_ns, ended_ns : int or None
        Mission times of its acceptance and of its end.
    reason : str
        Reason for its state.
    result : mapping
        Result of a completed job: kind, id, delivered.
    retry_after_s : float or None
        Retry time of a job displaced by one of higher priority.
    is_stopped : bool
        Set when the orchestrator stops.
    timing : Timing
    changed : Signal
        Set by each change that concerns the job.
    cancelled : Signal
        Set when the job is cancelled, displaced or stopped.
    """

    id: str
    request: ProductRequest
    deadline_s: float
    accepted_ns: int
    opened_ns: int | None = None
    ended_ns: int | None = None
    state: JobState = JobState.RECEIVED
    reason: str = ""
    plan: Mapping[str, Any] | None = None
    result: Mapping[str, Any] | None = None
    retry_after_s: float | None = None
    is_stopped: bool = False
    timing: Timing = REAL
    changed: Signal = field(init=False)
    cancelled: Signal = field(init=False)

    def __post_init__(self) -> None:
        self.changed, self.cancelled = self.timing.signal(), self.timing.signal()

    def cancel(self) -> None:
        """Let the job end soon."""
        self.cancelled.set()
        self.changed.set()

    def remaining_s(self) -> float:
        """Return the seconds until the reply is due."""
        return self.deadline_s - self.timing.now_s()

    def check_cancelled(self) -> None:
        """Raise UnavailableError if the job was cancelled or stopped, OverloadedError if it was displaced."""
        if self.is_stopped:
            raise _stopping_error()
        if self.retry_after_s is not None:
            raise OverloadedError(
                f"job {self.id} of priority {self.request.priority} was displaced by one of higher priority",
                retry_after_s=self.retry_after_s,
            )
        if self.cancelled.is_set():
            raise UnavailableError(f"job {self.id} was cancelled")

    def describe(self) -> dict[str, Any]:
        """Return plain data for job lists."""
        return {
            "job": self.id,
            "state": str(self.state),
            "reason": self.reason,
            "accepted_ns": self.accepted_ns,
            "opened_ns": self.opened_ns,
            "ended_ns": self.ended_ns,
            "remaining_s": None if self.state in FINAL_STATES else round(self.remaining_s(), 3),
            "request": self.request.describe(),
            "plan": self.plan,
            "result": self.result,
        }


class JobRegistry:
    """Jobs of one orchestrator.

    Parameters
    ----------
    journal : Journal
        Written before each change of state takes effect.
    capacity : int
        Largest number of open jobs.
    ended_limit : int
        Number of ended jobs in lists.
    """

    def __init__(
        self,
        journal: Journal,
        capacity: int,
        ended_limit: int = 200,
        timing: Timing = REAL,
    ) -> None:
        self._journal = journal
        self._capacity = capacity
        self._ended_limit = ended_limit
        self._timing = timing
        self._is_stopping = False
        self._lock = timing.lock()
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._open: dict[str, Job] = {}  # by the id of the request
        self._ended: dict[str, None] = {}  # ids of ended jobs, the first one first
        self._past: dict[str, Mapping[str, Any]] = {}  # of earlier processes

    def add_ended(self, ended: Iterable[Mapping[str, Any]]) -> None:
        """Add ended jobs of an earlier process, in the form of ``Job.describe``."""
        with self._lock:
            self._past = {str(job["job"]): job for job in ended}

    def open(self, request: ProductRequest) -> Job:
        """Accept a request; at full capacity it displaces the newest job of the lowest priority below its
        own.

        Raises
        ------
        OverloadedError
            If too many are open and none has a lower priority.
        InputError
            If a request of the same name is open.
        """
        with self._lock:
            if self._is_stopping:
                raise _stopping_error()
            if request.id in self._open:
                raise InputError(f"request={request.id}: a request with this id is open; use a new id")
            displaced = self._displace(request)
            deadline_s = self._timing.now_s() + request.deadline_s
            job = Job(str(uuid.uuid4()), request, deadline_s, wall_ns(), timing=self._timing)
            self._jobs[job.id] = self._open[request.id] = job
            # Displaced jobs that have not ended yet leave room for fewer ended ones.
            listed = max(len(self._ended), len(self._jobs) - self._capacity)
            for _ in range(min(listed - self._ended_limit, len(self._ended))):
                job_id = next(iter(self._ended))
                del self._jobs[job_id], self._ended[job_id]
        job.opened_ns = self._journal.append(
            "job",
            # A client with progress replies has been notified of the job: the record must be durable.
            durable=request.progress,
            job=job.id,
            robot=request.robot,
            state=str(job.state),
            request=request.describe(),
        )
        if displaced is not None:
            self._journal.append("decision", job=displaced.id, displaced_by=job.id)
        return job

    def stop(self, timeout_s: float) -> None:
        """End all open jobs as retriable, refuse new ones, and wait until they have ended."""
        with self._lock:
            self._is_stopping = True
            stopped = list(self._open.values())
            for job in stopped:
                job.is_stopped = True
                job.cancel()
        until_s, pause = self._timing.now_s() + timeout_s, self._timing.event()
        while any(j.state not in FINAL_STATES for j in stopped) and self._timing.now_s() < until_s:
            pause.wait(_STOP_PERIOD_S)

    def _displace(self, request: ProductRequest) -> Job | None:
        """Return the displaced job, or None if there is capacity; raises OverloadedError."""
        if len(self._open) < self._capacity:
            return None
        candidates = [j for j in self._open.values() if j.retry_after_s is None]
        if len(candidates) < self._capacity:
            return None
        retry_after_s = max(min(j.remaining_s() for j in candidates), 0.1)
        lower = [
            j
            for j in candidates
            if j.request.priority < request.priority and j.state is not JobState.DELIVERING
        ]
        if not lower:
            raise OverloadedError(
                f"{len(candidates)} requests of priority {request.priority} or more are open",
                retry_after_s=retry_after_s,
            )
        displaced = max(lower, key=lambda j: (-j.request.priority, j.accepted_ns))
        displaced.retry_after_s = retry_after_s
        displaced.cancel()
        return displaced

    def move(self, job: Job, state: JobState, reason: str = "", **more: Any) -> None:
        """Change the state of a job and write it to the journal."""
        with self._lock:
            job.state = next_job_state(job.state, state)
            job.reason = reason
            job.plan = more.get("plan", job.plan)
            job.result = more.get("result", job.result)
            if state in FINAL_STATES:
                self._open.pop(job.request.id, None)
                self._ended[job.id] = None
        stamp_ns = self._journal.append(
            "job",
            durable=job.request.progress and state in FINAL_STATES,
            job=job.id,
            robot=job.request.robot,
            state=str(state),
            reason=reason,
            **more,
        )
        if state in FINAL_STATES:
            job.ended_ns = stamp_ns

    def renew(self, job_id: str, lease_s: float) -> Job:
        """Extend a standing request to ``lease_s`` from now.

        Raises
        ------
        ProductNotFoundError
            If there is no such job, or it has ended.
        InputError
            If it is not a standing request.
        """
        job = self.get(job_id)
        if job.request.every_s is None:
            raise InputError(f"job {job.id} is not a standing request: its deadline is fixed")
        with self._lock:
            if job.state in FINAL_STATES:
                raise ProductNotFoundError(f"job {job.id} has ended ({job.state}); send a new request")
            job.deadline_s = self._timing.now_s() + lease_s
        return job

    def describe(self, job_id: str) -> dict[str, Any]:
        """Return a job as plain data by its id or request id, also of an earlier process.

        Raises
        ------
        ProductNotFoundError
            If there is no such job.
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
        """Return a job of this process by its id or request id; raises ProductNotFoundError."""
        with self._lock:
            for job in reversed(self._jobs.values()):
                if job_id in (job.id, job.request.id):
                    return job
        raise ProductNotFoundError(f"no job {job_id[:64]!r}: unknown, or removed after its end")

    def listed(self, robots: set[str], limit: int, *, only_open: bool = False) -> list[dict[str, Any]]:
        """Return the newest jobs for any of ``robots``, newest first."""
        with self._lock:
            jobs = self._open if only_open else self._jobs
            listed_jobs = [j for j in reversed(jobs.values()) if j.request.robot in robots | {"any"}]
            if only_open:
                return [j.describe() for j in listed_jobs[:limit]]
            past = [
                dict(j)
                for j in reversed(self._past.values())
                if j["request"].get("robot") in robots | {"any"}
            ]
            return [*(j.describe() for j in listed_jobs), *past][:limit]
