# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Requests that the orchestrators of robots execute for jobs of the orchestrator on the ground.

A job on the ground leases the DFPCs of its plan as usual. For a robot that has an orchestrator of its own,
the lease is a request to the orchestrator of the robot, with ``deliver=none``: the product appears in the
DPM, where the job finds it. Equal jobs share a request, except for single acquisitions. The request is
repeated while a job needs it, and cancelled when the ground takes over the control of the robot, so that
every job has one final reply, whichever orchestrator controls the robot.
"""

from __future__ import annotations

import logging
import threading
import uuid
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace

from cdff_common.bus import Bus, Reply, keys
from cdff_common.clock import Clock
from cdff_common.contract.limits import DEADLINE_BOUNDS_MS, MAX_JOBS
from cdff_common.errors import CdffError, DeadlineError, NoAnswerError, ProductNotFoundError, UnavailableError
from cdff_common.loops import Loops
from cdff_core.orchestration.planner import Plan
from cdff_core.orchestration.world import ProviderId
from services.orchestrator.jobs import Job
from services.orchestrator.shared_queries import query_key
from services.orchestrator.state import SystemState
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Beginning of the ids of delegated requests.
DELEGATED = "delegated-"
#: Pause before a request or a cancellation is repeated, and longest wait without a change, seconds.
_REPEAT_S, _IDLE_S = 1.0, 5.0
#: Least and longest time for a request, and time for its transmission, seconds.
_LEAST_S, _LONGEST_S, _TRANSMISSION_S = 0.2, DEADLINE_BOUNDS_MS[1] / 1000, 0.5
_CALL_S, _BUSY_LIMIT_S = 1.0, 60.0


@dataclass(frozen=True, slots=True)
class _Need:
    """A plan of a job; ``number`` counts the plans of all jobs."""

    job: Job
    plan: Plan
    number: int


@dataclass(slots=True, eq=False)
class _Delegation:
    """A request to the orchestrator of a robot.

    Attributes
    ----------
    providers : set of ProviderId
        DFPCs of the plans that provide the product; a failure of the request counts as a failure of each.
    priority : int
        Priority of the request that runs.
    sent_id : str
        Id of the request while it runs; empty otherwise.
    not_before_s : float
        Earliest time of the next one, monotonic seconds.
    """

    robot: str
    providers: set[ProviderId] = field(default_factory=set)
    priority: int = -1
    sent_id: str = ""
    not_before_s: float = float("-inf")


class Delegations:
    """Thread that keeps the delegated requests equal to the needs of the jobs.

    Parameters
    ----------
    bus : Bus
    state : SystemState
    loops : Loops
    clock : Clock
        Mission clock.
    timing : Timing, optional
    """

    def __init__(
        self, bus: Bus, state: SystemState, loops: Loops, clock: Clock, timing: Timing = REAL
    ) -> None:
        self._bus, self._state, self._clock, self._timing = bus, state, clock, timing
        self._loop = loops.add("delegations", _BUSY_LIMIT_S)
        self._changed: threading.Condition = timing.condition()
        self._version, self._done_version, self._wait_s = 0, -1, 0.0
        self._is_closed = False
        self._count = 0
        self._needs_of: dict[str, _Need] = {}  # by the id of the job
        self._delegations: dict[Hashable, _Delegation] = {}
        #: Robots whose orchestrators may still execute requests that no job of this orchestrator needs, with
        #: the time of the next check, monotonic seconds.
        self._unchecked: dict[str, float] = {}
        self._faults: dict[str, str] = {}  # last reported failure of each robot

    def start(self) -> None:
        """Start the thread."""
        self._timing.start(lambda: self._loop.run(self._wait, self._synchronise), "delegations")

    def close(self) -> None:
        """Stop; the requests end with their leases."""
        with self._changed:
            self._is_closed = True
        self.update()

    def hold(self, job: Job, plan: Plan) -> None:
        """Replace the requests of a job by those that a plan needs."""
        with self._changed:
            self._count += 1
            self._needs_of[job.id] = _Need(job, plan, self._count)
        self.update()

    def release(self, job_id: str) -> None:
        """End the requests of a job that no other job shares."""
        with self._changed:
            if self._needs_of.pop(job_id, None) is None:
                return
        self.update()

    def follow(self, robot: str) -> None:
        """Cancel the requests that the orchestrator of a robot has from an earlier process on the ground, or
        from the time before its link was cut.
        """
        with self._changed:
            self._unchecked[robot] = self._timing.now_s()
        self.update()

    def update(self) -> None:
        """Compare the requests with the needs, also after a change of control."""
        with self._changed:
            self._version += 1
            self._changed.notify_all()

    # -- thread

    def _wait(self) -> bool | None:
        """Wait for a change or the time of the next request; return None once closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._version != self._done_version, timeout=self._wait_s)
            self._done_version, self._wait_s = self._version, _IDLE_S
            return None if self._is_closed else True

    def _synchronise(self, _: object) -> None:
        needs = self._needs()
        for key in self._delegations.keys() - needs.keys():
            self._cancel(self._delegations.pop(key))
        for key, (robot, wanting) in needs.items():
            self._continue(self._delegations.setdefault(key, _Delegation(robot)), wanting)
        with self._changed:
            unchecked = dict(self._unchecked)
        for robot, due_s in unchecked.items():
            # A robot that the ground controls is checked after the hand-over.
            if not self._state.controls(robot) and self._is_due(due_s):
                self._cancel_unneeded(robot, due_s)

    def _needs(self) -> dict[Hashable, tuple[str, list[_Need]]]:
        """Return the plans that need a request, by robot and by request."""
        with self._changed:
            all_needs = list(self._needs_of.values())
        needs: dict[Hashable, tuple[str, list[_Need]]] = {}
        for need in all_needs:
            request = need.job.request
            shared: Hashable = (query_key(request), request.every_s)
            for robot in sorted({p.robot for p in need.plan.order}):
                if self._state.controls(robot) or self._is_acquired(need, robot):
                    continue
                key = (robot, shared if request.acquire is None else (need.job.id, need.number))
                needs.setdefault(key, (robot, []))[1].append(need)
        return needs

    def _is_acquired(self, need: _Need, robot: str) -> bool:
        """Return True if a plan with single acquisitions on a robot has made them all."""
        sensors = [sensor for sensor in need.plan.acquisitions if sensor.robot == robot]
        is_pending = self._state.is_acquisition_pending
        return bool(sensors) and not any(is_pending(need.job.id, sensor) for sensor in sensors)

    def _continue(self, delegation: _Delegation, needs: Sequence[_Need]) -> None:
        """Send a request unless it runs with sufficient priority, or has to wait."""
        product = needs[0].job.request.product
        planned = {p for need in needs for p in need.plan.order if p.robot == delegation.robot}
        delegation.providers = {p for p in planned if product in self._state.products_of(p)}
        priority = max(need.job.request.priority for need in needs)
        if delegation.sent_id and priority <= delegation.priority:
            return
        self._cancel(delegation)
        if not self._is_due(delegation.not_before_s):
            return
        remaining_s = max(need.job.remaining_s() for need in needs) - _TRANSMISSION_S
        if remaining_s >= _LEAST_S:
            self._send(delegation, needs[0], priority, min(remaining_s, _LONGEST_S))

    def _is_due(self, time_s: float) -> bool:
        """Return True if a time has come; otherwise the thread waits for it at most."""
        wait_s = time_s - self._timing.now_s()
        if wait_s > 0.0:
            self._wait_s = min(self._wait_s, wait_s)
        return wait_s <= 0.0

    def _send(self, delegation: _Delegation, need: _Need, priority: int, deadline_s: float) -> None:
        sent = replace(
            need.job.request,
            id=f"{DELEGATED}{uuid.uuid4()}",
            robot=delegation.robot,
            priority=priority,
            deadline_s=deadline_s,
            window_ns=None,
            deliver="none",
            progress=False,
        )
        delegation.sent_id, delegation.priority = sent.id, priority
        sent_ns = self._clock.now_ns()

        def on_end(result: Reply | CdffError) -> None:
            self._on_end(delegation, need, sent.id, sent_ns, result)

        key = keys.orchestrator_rpc(delegation.robot, "request")
        try:
            self._bus.call_in_background(
                key, sent.parameters(), on_end, timeout_s=deadline_s + _TRANSMISSION_S, elsewhere=True
            )
        except CdffError as error:
            on_end(error)

    def _on_end(
        self, delegation: _Delegation, need: _Need, sent_id: str, sent_ns: int, result: Reply | CdffError
    ) -> None:
        with self._changed:
            if delegation.sent_id != sent_id:
                return  # it was cancelled from here
            delegation.sent_id = ""
            pause_s = getattr(result, "retry_after_s", None) or _REPEAT_S
            delegation.not_before_s = self._timing.now_s() + pause_s
        if isinstance(result, Reply):
            for sensor, acquisition in need.plan.acquisitions.items():
                if sensor.robot == delegation.robot:
                    values = acquisition.parameters.to_dict()
                    self._state.end_acquisition(need.job.id, sensor, values, sent_ns)
        elif _is_failure(result):
            logger.info("the orchestrator of %s: %s", delegation.robot, result)
            for provider in delegation.providers:
                self._state.add_failure(provider, f"the orchestrator of {delegation.robot}: {result}")
        self.update()

    def _cancel(self, delegation: _Delegation) -> None:
        """Cancel the request that runs; without an answer all requests of its robot are checked."""
        with self._changed:
            sent_id, delegation.sent_id = delegation.sent_id, ""
        if not sent_id:
            return

        def on_end(result: Reply | CdffError) -> None:
            if isinstance(result, UnavailableError):
                with self._changed:
                    self._unchecked[delegation.robot] = self._timing.now_s() + _REPEAT_S
                self.update()

        key = keys.orchestrator_rpc(delegation.robot, "cancel")
        try:
            self._bus.call_in_background(key, {"job": sent_id}, on_end, timeout_s=_CALL_S, elsewhere=True)
        except CdffError as error:
            on_end(error)

    def _cancel_unneeded(self, robot: str, due_s: float) -> None:
        """Cancel the delegated requests of a robot that no job here needs; repeated until it answers.

        ``due_s`` is the time of this check; a check that is demanded meanwhile follows.
        """
        try:
            self._call_cancel_unneeded(robot)
        except CdffError as error:
            if self._faults.get(robot) != str(error):
                self._faults[robot] = str(error)
                logger.warning("requests of %s are not cancelled yet: %s", robot, error)
            with self._changed:
                self._unchecked[robot] = self._timing.now_s() + _REPEAT_S
            self._wait_s = min(self._wait_s, _REPEAT_S)
            return
        with self._changed:
            if self._unchecked.get(robot) == due_s:
                del self._unchecked[robot]
        self._faults.pop(robot, None)

    def _call_cancel_unneeded(self, robot: str) -> None:
        key, query = keys.orchestrator_rpc(robot, "jobs"), {"limit": MAX_JOBS, "state": "open"}
        jobs = self._bus.call(key, query, timeout_s=_CALL_S, elsewhere=True).body()["jobs"]
        needed = {delegation.sent_id for delegation in self._delegations.values()}
        for job in jobs:
            request_id = str(job["request"].get("request"))
            if request_id.startswith(DELEGATED) and request_id not in needed:
                key = keys.orchestrator_rpc(robot, "cancel")
                try:
                    self._bus.call(key, {"job": request_id}, timeout_s=_CALL_S, elsewhere=True)
                except ProductNotFoundError:
                    logger.debug("request %s of %s has ended meanwhile", request_id, robot)


def _is_failure(error: CdffError) -> bool:
    """Return True for an error that speaks against the DFPCs, not for a late, missing or deferred answer."""
    is_deferred = isinstance(error, UnavailableError) and error.retry_after_s is not None
    return not is_deferred and not isinstance(error, (DeadlineError, NoAnswerError))
