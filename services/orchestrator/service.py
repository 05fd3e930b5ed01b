# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The orchestrator of the robots of a profile: assembly of its parts, and endpoints."""

from __future__ import annotations

import logging
import uuid
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from cdff_common.bus import Bus, Pause, Reply, Request, keys
from cdff_common.bus.handler_pool import HandlerPool
from cdff_common.contract.queries import (
    CatalogueParameters,
    JobParameters,
    JobsParameters,
    RenewParameters,
    RobotParameters,
)
from cdff_common.errors import CdffError, ProductNotFoundError, UnavailableError
from cdff_common.interfaces.profile import Profile, profile_of_scope, scopes_of
from cdff_common.interfaces.robot_profile import RobotProfile
from cdff_common.loops import Loops
from cdff_core.orchestration.journal import recover
from cdff_core.orchestration.request import ProductRequest, parse_request, parse_robot, requested_type
from services.alarms import Alarms
from services.orchestrator.bus_products import BusProducts
from services.orchestrator.control import Control, parse_hand_over, record_changes
from services.orchestrator.delegations import DELEGATED, Delegations
from services.orchestrator.dpm import DpmClient
from services.orchestrator.history import HistoryForwarder, history_origin
from services.orchestrator.jobs import JobRegistry
from services.orchestrator.journal import Journal
from services.orchestrator.leader import claim_robot
from services.orchestrator.metrics import Metrics
from services.orchestrator.mode_alarms import ModeAlarms
from services.orchestrator.planning import RequestPlanner
from services.orchestrator.product_finder import ProductFinder
from services.orchestrator.reconciler import Reconciler
from services.orchestrator.reply import ReplyBuilder
from services.orchestrator.request_flow import RequestFlow
from services.orchestrator.schedule import Schedule
from services.orchestrator.state import SystemState
from services.orchestrator.system_monitor import SystemMonitor
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Reason of failure of the jobs that were open when the last process ended.
RESTARTED = "the orchestrator was restarted: ask again"
#: Default of the largest number of open requests.
CAPACITY = 2048
#: Threads for requests of all scopes, which occupy none while they wait, and for the other calls.
_REQUEST_THREADS, _CALL_THREADS = 16, 8
#: Number of requests that are processed at the same time, apart from those that wait for the DPM.
_RUNNING = 4
#: Additional calls of requests: refusals, explanations and requests that displace a job.
_EXTRA_CALLS = 32
#: Longest wait for an orchestrator of a robot, seconds.
_ELSEWHERE_S = 1.0
#: Longest wait for the end of the open requests when the process stops, seconds.
_STOP_S = 1.0
#: Size above which the journal is compacted at the start, bytes.
_COMPACTION_BYTES = 16 << 20


#: Service in the liveliness tokens of the scopes in which the ground stands in for the robots' own
#: orchestrators.
STAND_IN = "orchestrator_ground"


class Orchestrator:
    """Service ``request jobs cancel renew catalogue stat`` for every robot of a profile and for ``ground``.

    Further robots may join and leave; it is a ``RosterListener``. With a scope it is one of several: see
    ``control``.

    Parameters
    ----------
    bus : Bus
    profile : Profile
    journal_path : Path
    capacity : int
        Largest number of open requests; further ones are refused as OVERLOADED.
    timing : Timing, optional
        Time and threads; default: those of the system.
    scope : str
        ``ground`` for the orchestrator of a ground whose robots have their own, the id of a robot for one of
        those; empty for the only orchestrator.

    Attributes
    ----------
    alarms : Alarms
        Alarms of this process; their owner publishes them and updates ``mode_alarms``.
    """

    def __init__(
        self,
        bus: Bus,
        profile: Profile,
        journal_path: Path,
        capacity: int = CAPACITY,
        timing: Timing = REAL,
        scope: str = "",
    ) -> None:
        self._bus = bus
        self._scope = scope
        profile = profile_of_scope(profile, scope)
        self._ground_robots = profile.robot_ids
        self._scopes: set[str] = set()
        self._capacity = capacity
        self._metrics = Metrics()
        self.loops = Loops(timing.now_s)
        self.alarms = Alarms()
        self.mode_alarms = ModeAlarms(self.alarms, timing)
        self._journal = Journal(journal_path, bus.mission_clock)
        self._journal.listen(self._metrics.on_record)
        self._state = SystemState(profile, timing)
        self._jobs = JobRegistry(self._journal, capacity, timing=timing)
        scheduled = self._recover()
        own_scope = scope or keys.GROUND
        dpm, self._bus_products = DpmClient(bus, timing), None
        if own_scope != keys.GROUND:
            self._bus_products = BusProducts(bus, scope, self._state)
            dpm = DpmClient(bus, timing, self._bus_products.newest, scope)
        clock = bus.mission_clock
        self._delegations = (
            Delegations(bus, self._state, self.loops, clock, timing) if scope == keys.GROUND else None
        )
        finder = ProductFinder(dpm, clock, lambda: self._state.profile)
        self._planning = RequestPlanner(self._state, finder, clock, timing)
        reply_builder = ReplyBuilder(dpm, clock)
        self._flow = RequestFlow(
            self._state,
            finder,
            self._planning,
            reply_builder,
            self._jobs,
            self._journal,
            clock,
            timing,
            self._delegations,
        )
        self._schedule = Schedule(
            self._flow.run, lambda job: self._jobs.get(job).cancel(), self._journal, clock, self.loops, timing
        )
        self._schedule.recover(scheduled)
        self._monitor = SystemMonitor(bus, self._state, self.loops, timing)
        self._reconciler = Reconciler(bus, self._state, self._journal, self.loops, self.mode_alarms, timing)
        self._control = (
            None
            if self._delegations is None
            else Control(
                bus, self._state, self._reconciler, self._delegations, self._journal, self.loops, timing
            )
        )
        # Two orchestrators of a mission serve different robots: each has its own history.
        origin = history_origin(scope or profile.robot_ids[0])
        self._history = HistoryForwarder(bus, self._journal, origin, self.loops, timing, own_scope)
        self._request_pool = HandlerPool(_REQUEST_THREADS, _RUNNING, "request")
        self._call_pool = ThreadPoolExecutor(_CALL_THREADS, thread_name_prefix="call")

    def start(self) -> None:
        """Start all parts; the liveliness tokens come last, when the service is ready."""
        scopes = scopes_of(self._ground_robots, self._scope)
        if self._control is not None and self._delegations is not None:
            self._delegations.start()
            self._control.start()
        if self._bus_products is not None:
            self._bus_products.start()
        self._monitor.start()
        self._reconciler.start()
        self._history.start()
        self._schedule.start()
        for scope in scopes:
            self._serve(scope)
        for scope in scopes:
            self._bus.declare_alive(scope, self._service_of(scope))
        logger.info("orchestrating %s", ", ".join(self._ground_robots))

    def _stands_in(self, scope: str) -> bool:
        """Return True if the orchestrator of a robot has precedence in its scope."""
        return self._scope == keys.GROUND and scope != keys.GROUND

    def _service_of(self, scope: str) -> str:
        """Return the service in the liveliness token of a scope."""
        return STAND_IN if self._stands_in(scope) else "orchestrator"

    def _serve(self, scope: str) -> None:
        self._scopes.add(scope)
        stands_in = self._stands_in(scope)
        # Further calls are answered with OVERLOADED at once, not after the deadline.
        self._bus.serve(
            keys.orchestrator_rpc(scope, "request"),
            self._on_request,
            workers=_REQUEST_THREADS,
            backlog=self._capacity + _EXTRA_CALLS,
            pool=self._request_pool,
            stands_in=stands_in,
        )
        handlers = {
            "jobs": self._on_jobs,
            "cancel": self._on_cancel,
            "renew": self._on_renew,
            "catalogue": self._on_catalogue,
            "stat": self._on_stat,
        }
        if self._scope == scope != keys.GROUND:
            handlers["hand_over"] = self._on_hand_over
        for verb, handler in handlers.items():
            key = keys.orchestrator_rpc(scope, verb)
            self._bus.serve(key, handler, pool=self._call_pool, stands_in=stands_in)

    def set_robot(self, joined: RobotProfile) -> None:
        """Orchestrate a robot that has joined, or another revision of its profile.

        Raises
        ------
        ConfigurationError
            If the robot has a DFPC that is not installed here.
        UnavailableError
            If another orchestrator leads the robot.
        """
        robot = joined.robot.id
        if self._scope not in ("", keys.GROUND, robot):
            return  # it has an orchestrator of its own
        if robot not in self._ground_robots and self._control is None:
            claim_robot(self._bus, robot)
        if self._control is not None and robot not in self._scopes:
            self._control.follow(robot)
        self._state.set_robot(joined)
        if robot not in self._scopes:
            self._serve(robot)
        self._monitor.follow(robot)
        if robot not in self._ground_robots:
            self._bus.declare_alive(robot, self._service_of(robot))

    def remove_robot(self, robot: str) -> None:
        """Stop planning with a robot that has left; its scope answers, and its stored products are served."""
        self._state.remove_robot(robot)
        self._bus.withdraw_token(keys.alive(robot, self._service_of(robot)))

    def close(self) -> None:
        """End the open requests as retriable and stop; active DFPCs stay active, and the next orchestrator
        finds them in the journal.
        """
        self._schedule.close()
        self._jobs.stop(_STOP_S)
        self._request_pool.close()
        if self._control is not None and self._delegations is not None:
            self._control.close()
            self._delegations.close()
        self._reconciler.close()
        self._monitor.close()
        self._history.close()
        self._journal.close()

    def _recover(self) -> list[dict[str, Any]]:
        """Recover from the journal: open jobs have failed, and their providers start to linger; return the
        scheduled requests.
        """
        recovered = recover(self._journal.records())
        if self._journal.size > _COMPACTION_BYTES:
            self._journal.compact(recovered.records())
        for job in recovered.open_jobs:
            self._journal.append("job", job=job, state="failed", reason=RESTARTED)
        self._jobs.add_ended([*recovered.ended, *recovered.interrupted_jobs(RESTARTED)])
        self._journal.append(
            "start", open_jobs=len(recovered.open_jobs), owned=[str(m) for m in sorted(recovered.owned)]
        )
        self._state.recover(recovered.owned, recovered.modes)
        return list(recovered.scheduled.values())

    # -- endpoints

    def _on_request(self, call: Request) -> Reply | Iterator[Reply | Pause]:
        request_id = call.parameters.get("request") or str(uuid.uuid4())
        description: Mapping[str, Any] = {**call.parameters, "request": request_id}
        try:
            request = parse_request({**call.parameters, "request": request_id}, call.scope)
            if request.robot not in (*self._state.profile.robot_ids, "any"):
                raise self._unknown_robot(request.robot)
            description = request.describe()
            if request.window_ns is not None and not request.explain:
                return self._add_scheduled(request, call)
            return self._planning.explain(request) if request.explain else self._flow.run(request)
        except CdffError as error:
            error.request, error.asked = request_id, description
            raise

    def _add_scheduled(self, request: ProductRequest, call: Request) -> Reply:
        """Schedule a request, and reply at once with the plan that is possible now."""
        explanation = self._planning.explain(request).body()
        plan = explanation["plan"]
        parameters = {**call.parameters, "request": request.id}
        self._schedule.add(request, parameters, call.scope, None if plan is None else plan["ready_s"])
        body = {"request": request.id, "state": "scheduled", "asked": request.describe(), "plan": plan}
        return Reply.of(
            body | {"why_not": explanation["why_not"]}, kind="scheduled", final=True, request=request.id
        )

    def _on_jobs(self, call: Request) -> Reply:
        p = JobsParameters.parse(call.parameters)
        if p.job is not None:
            try:
                return Reply.of({"jobs": [self._job(p.job)]})
            except ProductNotFoundError as error:
                return self._answer_elsewhere(call, error)
        robots = self._robots(call)
        jobs = self._jobs.listed(robots, p.limit, only_open=p.state == "open")
        scheduled = self._schedule.listed(robots)
        parameters = {"limit": p.limit, "state": p.state}
        answers, unreachable = self._answers_elsewhere("jobs", parameters, robots)
        for body in answers:
            jobs += [j for j in body["jobs"] if not str(j["request"].get("request")).startswith(DELEGATED)]
            scheduled += body["scheduled"]
        jobs.sort(key=lambda job: -(job["accepted_ns"] or 0))
        return Reply.of(
            {
                "jobs": jobs[: p.limit],
                "scheduled": scheduled,
                "leases": self._state.leases(),
                "unreachable": unreachable,
            }
        )

    def _answers_elsewhere(
        self, verb: str, parameters: Mapping[str, object], robots: Iterable[str]
    ) -> tuple[list[dict[str, Any]], list[str]]:
        """Return the answers of the orchestrators of some robots, and the robots out of contact."""
        answers, unreachable = [], []
        for robot in sorted(robots):
            if self._state.controls(robot):
                continue
            key = keys.orchestrator_rpc(robot, verb)
            try:
                answers.append(self._bus.call(key, parameters, timeout_s=_ELSEWHERE_S, elsewhere=True).body())
            except UnavailableError:
                unreachable.append(robot)
            except CdffError as error:
                logger.debug("%s of %s: %s", verb, robot, error)
        return answers, unreachable

    def _answer_elsewhere(self, call: Request, error: ProductNotFoundError) -> Reply:
        """Return the answer of the orchestrator that has a job; raises ``error`` if none does, and
        UnavailableError if one that may have it is out of contact.
        """
        verb = call.key.rsplit("/", 1)[1]
        parameters = {name: value for name, value in call.parameters.items() if name != "robot"}
        answers, unreachable = self._answers_elsewhere(verb, parameters, self._robots(call))
        if answers:
            return Reply.of(answers[0])
        if unreachable:
            raise UnavailableError(f"{error}; out of contact: {', '.join(unreachable)}") from error
        raise error

    def _job(self, job: str) -> dict[str, Any]:
        """Return a scheduled request, or a job, as plain data."""
        try:
            return self._schedule.get(job).describe()
        except ProductNotFoundError:
            return self._jobs.describe(job)

    def _on_cancel(self, call: Request) -> Reply:
        job_id = JobParameters.parse(call.parameters).job
        with suppress(ProductNotFoundError):
            scheduled = self._schedule.cancel(job_id)
            return Reply.of({"job": job_id, "state": scheduled.state})
        try:
            job = self._jobs.get(job_id)
        except ProductNotFoundError as error:
            return self._answer_elsewhere(call, error)
        job.cancel()
        return Reply.of({"job": job.id, "state": str(job.state)})

    def _on_renew(self, call: Request) -> Reply:
        p = RenewParameters.parse(call.parameters)
        try:
            job = self._jobs.renew(p.job, p.deadline_ms / 1000)
        except ProductNotFoundError as error:
            return self._answer_elsewhere(call, error)
        return Reply.of({"job": job.id, "remaining_s": round(job.remaining_s(), 3)})

    def _on_hand_over(self, call: Request) -> Reply:
        """Own the DFPCs and sensors that the ground has switched in the absence of this process."""
        call.check_no_parameters()
        owned, sensors = parse_hand_over(call.body(), self._state.profile.robot(self._scope))
        record_changes(self._journal, owned, sensors, "handed over")
        self._state.recover(owned, sensors)
        return Reply.of({"robot": self._scope, "owned": len(owned), "sensors": len(sensors)})

    def _on_catalogue(self, call: Request) -> Reply:
        p = CatalogueParameters.parse(call.parameters)
        if p.type is not None:
            requested_type(p.type)
        return Reply.of(self._state.catalogue(self._robots(call), p.type))

    def _on_stat(self, call: Request) -> Reply:
        RobotParameters.parse(call.parameters)
        return Reply.of({**self._metrics.to_dict(), "loops": self.loops.describe()})

    def _robots(self, call: Request) -> set[str]:
        """Return the robots of a listing: all under ``ground`` unless the call states one."""
        if call.scope == keys.GROUND and call.parameters.get("robot", "any") == "any":
            return set(self._state.robot_ids)
        robot = parse_robot(call.parameters.get("robot"), call.scope)
        if robot not in self._state.profile.robot_ids:
            raise self._unknown_robot(robot)
        return {robot}

    def _unknown_robot(self, robot: str) -> ProductNotFoundError:
        robots = ", ".join(self._state.robot_ids)
        return ProductNotFoundError(f"no robot {robot!r}: expected any or one of {robots}")
