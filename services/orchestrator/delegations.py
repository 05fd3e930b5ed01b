# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Requests that the orchestrators of robots execute for jobs of the orchestrator on the ground.

A job on the ground leases the DFPCs of its plan as usual. For a robot that has an orchestrator of its own,
the lease is a request to that one, with ``deliver=none``: the product appears in the DPM, where the job finds
it. Equal jobs share a request. It is repeated while a job needs it, and dropped when the ground takes the
robot over, so that every job has one final reply independent of the owner of the robot.
"""

from __future__ import annotations

import logging
import threading
import uuid
from collections.abc import Hashable
from dataclasses import dataclass, field, replace

from cdff_common.bus import Bus, Reply, keys
from cdff_common.errors import CdffError, DeadlineError, NoAnswerError
from cdff_common.loops import Loops
from cdff_core.orchestration.planner import Plan
from cdff_core.orchestration.request import ProductRequest
from cdff_core.orchestration.world import ProviderId
from services.orchestrator.jobs import Job
from services.orchestrator.shared_queries import query_key
from services.orchestrator.state import SystemState
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Pause before a request is repeated after it was fulfilled or has failed, and longest wait without a change,
#: seconds.
_REPEAT_S, _IDLE_S = 1.0, 5.0
#: Least time for a request, and time for its transmission, seconds.
_LEAST_S, _TRANSMISSION_S = 0.2, 0.5
_BUSY_LIMIT_S = 60.0


@dataclass(slots=True, eq=False)
class _Delegation:
    """A request to the orchestrator of a robot.

    Attributes
    ----------
    providers : set of ProviderId
        DFPCs of the plans that provide the product; a failure of the request counts as a failure of each.
    sent_id : str
        Id of the request while it runs; empty otherwise.
    not_before_s : float
        Earliest time of the next one, monotonic seconds.
    """

    robot: str
    providers: set[ProviderId] = field(default_factory=set)
    sent_id: str = ""
    not_before_s: float = float("-inf")


class Delegations:
    """Thread that keeps the delegated requests equal to the needs of the jobs."""

    def __init__(self, bus: Bus, state: SystemState, loops: Loops, timing: Timing = REAL) -> None:
        self._bus, self._state, self._timing = bus, state, timing
        self._loop = loops.add("delegations", _BUSY_LIMIT_S)
        self._changed: threading.Condition = timing.condition()
        self._version, self._done_version, self._wait_s = 0, -1, 0.0
        self._is_closed = False
        self._held: dict[str, tuple[Job, Plan]] = {}
        self._delegations: dict[Hashable, _Delegation] = {}

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
            self._held[job.id] = (job, plan)
        self.update()

    def release(self, job_id: str) -> None:
        """End the requests of a job that no other job shares."""
        with self._changed:
            if self._held.pop(job_id, None) is None:
                return
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
            self._end(self._delegations.pop(key))
        now_s = self._timing.now_s()
        for key, (robot, jobs) in needs.items():
            delegation = self._delegations.setdefault(key, _Delegation(robot))
            product = jobs[0][0].request.product
            planned = {p for _, plan in jobs for p in plan.order if p.robot == robot}
            delegation.providers = {p for p in planned if product in self._state.products_of(p)}
            if delegation.sent_id:
                continue
            if delegation.not_before_s > now_s:
                self._wait_s = min(self._wait_s, delegation.not_before_s - now_s)
                continue
            deadline_s = max(job.remaining_s() for job, _ in jobs) - _TRANSMISSION_S
            if deadline_s >= _LEAST_S:
                priority = max(job.request.priority for job, _ in jobs)
                self._send(delegation, jobs[0][0].request, priority, deadline_s)

    def _needs(self) -> dict[Hashable, tuple[str, list[tuple[Job, Plan]]]]:
        """Return the jobs that need a request, by robot and by request."""
        with self._changed:
            held = list(self._held.values())
        needs: dict[Hashable, tuple[str, list[tuple[Job, Plan]]]] = {}
        for job, plan in held:
            for robot in sorted({p.robot for p in plan.order}):
                if not self._state.controls(robot):
                    key = (robot, query_key(job.request), job.request.every_s)
                    needs.setdefault(key, (robot, []))[1].append((job, plan))
        return needs

    def _send(
        self, delegation: _Delegation, request: ProductRequest, priority: int, deadline_s: float
    ) -> None:
        sent = replace(
            request,
            id=str(uuid.uuid4()),
            robot=delegation.robot,
            priority=priority,
            deadline_s=deadline_s,
            deliver="none",
            progress=False,
        )
        delegation.sent_id = sent.id

        def on_end(result: Reply | CdffError) -> None:
            self._on_end(delegation, sent.id, result)

        key = keys.orchestrator_rpc(delegation.robot, "request")
        try:
            self._bus.call_in_background(
                key, sent.parameters(), on_end, timeout_s=deadline_s + _TRANSMISSION_S, elsewhere=True
            )
        except CdffError as error:
            on_end(error)

    def _on_end(self, delegation: _Delegation, sent_id: str, result: Reply | CdffError) -> None:
        with self._changed:
            if delegation.sent_id != sent_id:
                return  # it was ended from here
            delegation.sent_id = ""
            delegation.not_before_s = self._timing.now_s() + _REPEAT_S
        if isinstance(result, CdffError) and not isinstance(result, (DeadlineError, NoAnswerError)):
            logger.info("the orchestrator of %s: %s", delegation.robot, result)
            for provider in delegation.providers:
                self._state.add_failure(provider, f"the orchestrator of {delegation.robot}: {result}")
        self.update()

    def _end(self, delegation: _Delegation) -> None:
        """Cancel a request; an answer is of no interest."""
        with self._changed:
            sent_id, delegation.sent_id = delegation.sent_id, ""
        if sent_id:
            key = keys.orchestrator_rpc(delegation.robot, "cancel")
            try:
                self._bus.call_in_background(key, {"job": sent_id}, lambda _: None, elsewhere=True)
            except CdffError as error:
                logger.info("request %s of %s is not cancelled: %s", sent_id, delegation.robot, error)
