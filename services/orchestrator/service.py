# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The orchestrator of some robots: its parts put together, its keys answered."""

from __future__ import annotations

import logging
import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.errors import CdffError, InputError
from cdff_common.interfaces.profile import Profile
from cdff_core.orchestration.journal import recover
from cdff_core.orchestration.request import PRODUCTS, parse_deadline_s, parse_request, parse_robot
from services.orchestrator.control import Controller
from services.orchestrator.delivery import Delivery
from services.orchestrator.dpm import Dpm
from services.orchestrator.finder import Finder
from services.orchestrator.flow import Flow
from services.orchestrator.history import HistoryForwarder
from services.orchestrator.jobs import JobBook
from services.orchestrator.journal import Journal
from services.orchestrator.metrics import Metrics
from services.orchestrator.planning import Planning
from services.orchestrator.state import State
from services.orchestrator.timing import REAL, Timing
from services.orchestrator.watcher import Watcher

logger = logging.getLogger(__name__)

#: Why jobs that were open when a process ended have failed.
RESTARTED = "the orchestrator was restarted: ask again"
#: Threads beyond the capacity: for who is told OVERLOADED, explained to, or admitted while another makes room.
_SPARE = 32
_JOBS = {"robot", "job", "limit"}
_MAX_LISTED = 200
#: A journal larger than this at the start is put aside; what it leads to is carried over.
_JOURNAL_BYTES = 16 << 20


class Orchestrator:
    """Answers ``request jobs cancel renew catalogue stat`` for every robot of a profile and for ``ground``.

    Parameters
    ----------
    bus : Bus
    profile : Profile
    journal_path : Path
    capacity : int
        Most requests open at a time; more are answered OVERLOADED.
    timing : Timing, optional
        Time and waiting; real by default.
    """

    def __init__(
        self, bus: Bus, profile: Profile, journal_path: Path, capacity: int = 64, timing: Timing = REAL
    ) -> None:
        self._bus = bus
        self._profile = profile
        self._capacity = capacity
        self._metrics = Metrics()
        self._journal = Journal(journal_path, bus.mission_clock)
        self._journal.listen(self._metrics.on_record)
        self._state = State(profile, timing)
        self._book = JobBook(self._journal, capacity, wake=self._state.touch, timing=timing)
        self._recover()
        clock, dpm = bus.mission_clock, Dpm(bus, timing)
        finder = Finder(dpm, clock, profile)
        self._planning = Planning(self._state, finder, clock, timing)
        delivery = Delivery(dpm, clock)
        self._flow = Flow(self._state, finder, self._planning, delivery, self._book, self._journal, clock, timing)
        self._watcher = Watcher(bus, self._state, timing)
        self._controller = Controller(bus, self._state, self._journal, timing)
        # Two orchestrators of a mission serve different robots: each has a history of its own.
        self._history = HistoryForwarder(bus, self._journal, "orchestrator/" + profile.robot_ids[0], timing)

    def start(self) -> None:
        """Hear, control, answer; the tokens come last, when it can answer."""
        scopes = (*self._profile.robot_ids, keys.GROUND)
        self._watcher.start()
        self._controller.start()
        self._history.start()
        for scope in scopes:
            # No backlog: what finds no free thread is told OVERLOADED at once instead of waiting past its deadline.
            self._bus.serve(
                keys.orchestrator_rpc(scope, "request"), self._on_request, workers=self._capacity + _SPARE, backlog=0
            )
            self._bus.serve(keys.orchestrator_rpc(scope, "jobs"), self._on_jobs)
            self._bus.serve(keys.orchestrator_rpc(scope, "cancel"), self._on_cancel)
            self._bus.serve(keys.orchestrator_rpc(scope, "renew"), self._on_renew)
            self._bus.serve(keys.orchestrator_rpc(scope, "catalogue"), self._on_catalogue)
            self._bus.serve(keys.orchestrator_rpc(scope, "stat"), self._on_stat)
        for scope in scopes:
            self._bus.declare_alive(scope, "orchestrator")
        logger.info("orchestrating %s", ", ".join(self._profile.robot_ids))

    def close(self) -> None:
        """Stop controlling; what runs keeps running, and the next orchestrator finds it in the journal."""
        self._controller.close()
        self._watcher.close()
        self._history.close()
        self._journal.close()

    def _recover(self) -> None:
        """Replay the journal: jobs that were open have failed, what they held starts to linger."""
        found = recover(self._journal.records())
        if self._journal.size > _JOURNAL_BYTES:
            self._journal.compact(found.records())
        for job in found.open_jobs:
            self._journal.append("job", job=job, state="failed", reason=RESTARTED)
        self._book.remember([*found.ended, *found.broken_off(RESTARTED)])
        self._journal.append("start", open_jobs=len(found.open_jobs), owned=[str(m) for m in sorted(found.owned)])
        for maker in found.owned:
            self._state.own(maker, owned=True)
        for sensor in found.modes:
            self._state.changed_mode(sensor)
        known = [m for m in found.owned if self._state.knows(m)]
        self._state.acquire("restart", known, {})
        self._state.release("restart")

    # -- answers ------------------------------------------------------------------------------------------------------

    def _on_request(self, call: Request) -> Reply | Iterator[Reply]:
        name = call.parameters.get("request") or str(uuid.uuid4())
        asked: Mapping[str, Any] = {**call.parameters, "request": name}
        try:
            request = parse_request({**call.parameters, "request": name}, call.scope)
            if request.robot not in (*self._profile.robot_ids, "any"):
                raise InputError(
                    f"robot={request.robot!r}: expected any or one of {', '.join(self._profile.robot_ids)}"
                )
            asked = request.describe()
            return self._planning.explain(request) if request.explain else self._flow.run(request)
        except CdffError as error:
            error.request, error.asked = name, asked
            raise

    def _on_jobs(self, call: Request) -> Reply:
        _check(call, _JOBS)
        if "job" in call.parameters:
            return Reply.of({"jobs": [self._book.describe(call.parameters["job"])]})
        text = call.parameters.get("limit", "50")
        if not text.isdigit() or not 1 <= int(text) <= _MAX_LISTED:
            raise InputError(f"limit={text!r}: expected 1 to {_MAX_LISTED}")
        return Reply.of({"jobs": self._book.listed(self._robots(call), int(text)), "leases": self._state.leases()})

    def _on_cancel(self, call: Request) -> Reply:
        _check(call, {"robot", "job"})
        if "job" not in call.parameters:
            raise InputError("parameter 'job' is missing: a job's or a request's id")
        job = self._book.get(call.parameters["job"])
        job.cancelled.set()
        self._state.touch()
        return Reply.of({"job": job.id, "state": str(job.state)})

    def _on_renew(self, call: Request) -> Reply:
        _check(call, {"robot", "job", "deadline_ms"})
        if "job" not in call.parameters:
            raise InputError("parameter 'job' is missing: a job's or a request's id")
        job = self._book.renew(call.parameters["job"], parse_deadline_s(call.parameters))
        return Reply.of({"job": job.id, "remaining_s": round(job.remaining_s(), 3)})

    def _on_catalogue(self, call: Request) -> Reply:
        _check(call, {"robot", "type"})
        product = call.parameters.get("type")
        if product is not None and product not in PRODUCTS:
            raise InputError(f"type={product!r}: expected one of {', '.join(PRODUCTS)}")
        return Reply.of(self._state.catalogue(self._robots(call), product))

    def _on_stat(self, call: Request) -> Reply:
        _check(call, {"robot"})
        return Reply.of(self._metrics.to_dict())

    def _robots(self, call: Request) -> set[str]:
        """Robots that a listing is about: all of them under ``ground`` unless one is named."""
        if call.scope == keys.GROUND and call.parameters.get("robot", "any") == "any":
            return set(self._profile.robot_ids)
        return {parse_robot(call.parameters.get("robot"), call.scope)}


def _check(call: Request, known: set[str]) -> None:
    unknown = sorted(set(call.parameters) - known)
    if unknown:
        raise InputError(f"unknown parameter {unknown[0]!r}; known are {', '.join(sorted(known))}")
