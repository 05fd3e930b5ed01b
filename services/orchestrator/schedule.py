# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Requests for a time window in the future: kept in the journal, and executed when their window begins.

The client gets a reply at once; its products are stored in the DPM, and their ids are listed with the request. A
request is executed from the time at which its DFPCs must start until the end of its window. A process that
restarts continues it; a window that has passed meanwhile is missed.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from cdff_common.bus import Pause, Reply
from cdff_common.bus.pause import without_pauses
from cdff_common.clock import NS_PER_S, Clock, format_stamp, wall_ns
from cdff_common.errors import (
    CdffError,
    InputError,
    OverloadedError,
    ProductNotFoundError,
    StorageError,
    UnavailableError,
)
from cdff_common.loops import Loops
from cdff_core.orchestration.request import ProductRequest, parse_request
from services.orchestrator.journal import Journal
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Largest number of requests whose windows overlap, since each occupies a thread, and of listed ended ones.
MAX_OVERLAPPING, _MAX_ENDED = 32, 100
#: Time before the window in which DFPCs start, in addition to their warm-up, and without a plan, seconds.
_LEAD_S, _UNKNOWN_LEAD_S = 2.0, 10.0
#: Period in which the mission time is compared with the windows, seconds.
_PERIOD_S = 0.5
#: Time between two attempts of a request for which no plan is possible, seconds.
_ATTEMPT_S = 2.0
_ENDED = ("done", "failed", "cancelled", "missed")


@dataclass(slots=True, eq=False)
class ScheduledRequest:
    """A request with a time window.

    Attributes
    ----------
    request : ProductRequest
    parameters, scope
        As received; they are in the journal.
    start_ns : int
        Mission time at which it is executed.
    accepted_ns : int
        Wall time at which it arrived.
    state : str
        scheduled, running, done, failed, cancelled or missed.
    products : list of str
        Ids of its products in the DPM.
    """

    request: ProductRequest
    parameters: Mapping[str, str]
    scope: str
    start_ns: int
    accepted_ns: int
    state: str = "scheduled"
    reason: str = ""
    products: list[str] = field(default_factory=list)

    @property
    def window_ns(self) -> tuple[int, int]:
        """Start and end of its window, mission time."""
        assert self.request.window_ns is not None
        return self.request.window_ns

    def describe(self) -> dict[str, Any]:
        """Return plain data in the form of a job."""
        return {
            "job": self.request.id,
            "state": self.state,
            "reason": self.reason,
            "accepted_ns": self.accepted_ns,
            "opened_ns": None,
            "ended_ns": None,
            "remaining_s": None,
            "request": self.request.describe(),
            "plan": None,
            "result": {"products": list(self.products)} if self.products else None,
        }


class Schedule:
    """Scheduled requests of one orchestrator, and the thread that executes them.

    Parameters
    ----------
    run : callable
        Executes a request, as ``RequestFlow.run``.
    cancel : callable
        Cancels the job of a running request by its id.
    """

    def __init__(
        self,
        run: Callable[[ProductRequest], Iterator[Reply | Pause]],
        cancel: Callable[[str], object],
        journal: Journal,
        clock: Clock,
        loops: Loops,
        timing: Timing = REAL,
    ) -> None:
        self._run_request, self._cancel_job = run, cancel
        self._journal = journal
        self._clock = clock
        self._timing = timing
        self._lock = timing.lock()
        self._stop, self._added = timing.event(), timing.event()
        self._entries: dict[str, ScheduledRequest] = {}
        self._loop = loops.add("schedule")

    def start(self) -> None:
        """Start the thread."""
        self._timing.start(lambda: self._loop.run(self._wait, self._start_due), "schedule")

    def close(self) -> None:
        """Stop; the next process continues the requests."""
        self._stop.set()
        self._added.set()

    def add(
        self, request: ProductRequest, parameters: Mapping[str, str], scope: str, ready_s: float | None
    ) -> ScheduledRequest:
        """Keep a request until its window; ``ready_s`` is the start-up time of its plan, None without one.

        Raises
        ------
        InputError
            If its window has passed, or a request with its id is scheduled.
        OverloadedError
            If too many other windows overlap with it.
        """
        assert request.window_ns is not None
        start_ns, end_ns = request.window_ns
        now_ns = self._clock.now_ns()
        if end_ns <= now_ns:
            raise InputError(f"t1={format_stamp(end_ns)}: expected later than now, {format_stamp(now_ns)}")
        lead_s = _UNKNOWN_LEAD_S if ready_s is None else ready_s + _LEAD_S
        begin_ns = start_ns - int(lead_s * NS_PER_S)
        entry = ScheduledRequest(request, dict(parameters), scope, begin_ns, wall_ns())
        with self._lock:
            known = self._entries.get(request.id)
            if known is not None and known.state not in _ENDED:
                raise InputError(f"request={request.id}: a request with this id is scheduled; use a new id")
            overlapping = [
                e
                for e in self._entries.values()
                if e.state not in _ENDED and e.start_ns < end_ns and entry.start_ns < e.window_ns[1]
            ]
            if len(overlapping) >= MAX_OVERLAPPING:
                first_end_ns = min(e.window_ns[1] for e in overlapping)
                raise OverloadedError(
                    f"{len(overlapping)} scheduled requests overlap with t0={format_stamp(start_ns)}, "
                    f"t1={format_stamp(end_ns)}: expected fewer than {MAX_OVERLAPPING}",
                    retry_after_s=max((first_end_ns - now_ns) / NS_PER_S, 1.0),
                )
            self._entries[request.id] = entry
        try:
            self._write(entry, "add", parameters=entry.parameters, scope=scope, start_ns=entry.start_ns)
        except StorageError:  # the request is not kept; the client gets this error
            with self._lock:
                self._entries.pop(request.id, None)
            raise
        self._added.set()
        return entry

    def recover(self, records: Iterable[Mapping[str, Any]]) -> None:
        """Continue with the requests in records of the journal that have not ended."""
        for record in records:
            parameters, scope = dict(record["parameters"]), str(record["scope"])
            try:
                request = parse_request(parameters, scope)
            except InputError as error:  # kept by another version
                logger.warning("scheduled request %s cannot be continued: %s", record["request"], error)
                self._journal.append(
                    "schedule", action="end", request=record["request"], state="failed", reason=str(error)
                )
                continue
            accepted_ns = int(record.get("at_ns", record["start_ns"]))
            entry = ScheduledRequest(request, parameters, scope, int(record["start_ns"]), accepted_ns)
            entry.products = [str(product) for product in record.get("products", ())]
            self._entries[request.id] = entry

    def get(self, request_id: str) -> ScheduledRequest:
        """Return a scheduled request by its id; raises ProductNotFoundError."""
        with self._lock:
            entry = self._entries.get(request_id)
        if entry is None:
            raise ProductNotFoundError(f"no scheduled request {request_id[:64]!r}")
        return entry

    def listed(self, robots: set[str]) -> list[dict[str, Any]]:
        """Return the scheduled requests for any of ``robots``, the earliest window first."""
        with self._lock:
            entries = [e for e in self._entries.values() if e.request.robot in robots | {"any"}]
        return [e.describe() for e in sorted(entries, key=lambda e: e.window_ns)]

    def cancel(self, request_id: str) -> ScheduledRequest:
        """Cancel a scheduled request; raises ProductNotFoundError."""
        entry = self.get(request_id)
        with self._lock:
            state = entry.state
            if state in ("scheduled", "running"):
                entry.state, entry.reason = "cancelled", "cancelled by a client"
        if state == "scheduled":
            self._end(entry)
        elif state == "running":
            with suppress(ProductNotFoundError):  # it waits for its next attempt
                self._cancel_job(request_id)
        return entry

    # -- execution

    def _wait(self) -> bool | None:
        """Wait for the next comparison with the mission time; return None once stopped."""
        with self._lock:
            is_waiting = any(e.state == "scheduled" for e in self._entries.values())
        self._added.wait(_PERIOD_S if is_waiting else None)
        self._added.clear()
        return None if self._stop.is_set() else True

    def _start_due(self, _: object) -> None:
        now_ns = self._clock.now_ns()
        with self._lock:
            due = [e for e in self._entries.values() if e.state == "scheduled" and e.start_ns <= now_ns]
            for entry in due:
                entry.state = "running" if entry.window_ns[1] > now_ns else "missed"
        for entry in due:
            if entry.state == "missed":
                entry.reason = "its window has passed while no orchestrator was running"
                self._end(entry)
            else:
                self._timing.start(lambda entry=entry: self._execute(entry), "scheduled")  # type: ignore[misc]

    def _execute(self, entry: ScheduledRequest) -> None:
        """Execute a request until it is fulfilled or its window ends; without a plan it is tried again."""
        while entry.state == "running":
            remaining_s = (entry.window_ns[1] - self._clock.now_ns()) / NS_PER_S
            if remaining_s <= 0.0:
                self._set(entry, "done" if entry.products else "failed", entry.reason)
                break
            try:
                self._run(entry, remaining_s)
                self._set(entry, "done", "")
            except UnavailableError as error:
                self._set(entry, "running", str(error))
                self._stop.wait(min(_ATTEMPT_S, remaining_s))
            except CdffError as error:
                self._set(entry, "failed", str(error))
            except Exception as error:  # an unexpected error of one request must not leave it running
                logger.exception("scheduled request %s failed", entry.request.id)
                self._set(entry, "failed", f"{type(error).__name__}: {error}")
            if self._stop.is_set():
                return  # the next process continues it
        logger.info("scheduled request %s: %s %s", entry.request.id, entry.state, entry.reason)
        self._end(entry)

    def _run(self, entry: ScheduledRequest, remaining_s: float) -> None:
        """Execute a request for the rest of its window, and record its products."""
        request = replace(entry.request, deadline_s=remaining_s, progress=False)
        if request.product != "pose":  # a cropped or converted product is stored; a pose never is
            request = replace(request, deliver="reference")
        for reply in without_pauses(self._run_request(request)):
            if reply.attachment["kind"] in ("product", "reference"):
                product = _stored_id(reply)
                entry.products.append(product)
                self._write(entry, "product", product=product)

    def _set(self, entry: ScheduledRequest, state: str, reason: str) -> None:
        """Set the state of a running request, unless it was cancelled."""
        with self._lock:
            if entry.state == "running":
                entry.state, entry.reason = state, reason

    def _end(self, entry: ScheduledRequest) -> None:
        """Record the end of a request, and remove the oldest ended ones."""
        self._write(entry, "end", state=entry.state, reason=entry.reason)
        with self._lock:
            ended = [name for name, e in self._entries.items() if e.state in _ENDED]
            for name in ended[: max(len(ended) - _MAX_ENDED, 0)]:
                del self._entries[name]

    def _write(self, entry: ScheduledRequest, action: str, **record: Any) -> None:
        self._journal.append(
            "schedule", action=action, request=entry.request.id, robot=entry.request.robot, **record
        )


def _stored_id(reply: Reply) -> str:
    """Return the id under which the DPM holds a product, or its source for a pose that was converted."""
    attachment = reply.attachment
    is_converted = attachment["kind"] == "product" and str(attachment["producer"]).startswith("orchestrator/")
    return str(attachment["inputs"][0] if is_converted and attachment["inputs"] else attachment["id"])
