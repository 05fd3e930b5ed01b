# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Status, health and metrics of the DPM, and the stream of events."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query
from fastapi.responses import PlainTextResponse, StreamingResponse

from cdff_common.bus import keys
from cdff_common.contract.queries import AlarmParameters, EventParameters, HistoryParameters
from cdff_common.errors import CdffError
from dpm_store import Event
from dpm_store.history.events import CHANGES
from services.alarms import Severity
from services.dpm.http.context import Context, Ctx, jsonable
from services.dpm.http.metrics import dpm_lines, gateway_lines, gateway_topics, orchestrator_lines
from services.dpm.http.middleware.roles import allowed
from services.dpm.http.native_models import AlarmBody, AlarmList, Changes, GatewayTopicList, Status
from services.dpm.operations.condition_monitor import check_disk

router = APIRouter(tags=["status"])

_KEEP_ALIVE_S = 15.0
#: Largest number of events that are read at once; each may take 64 kB.
_BATCH = 16
_METRICS_TIMEOUT_S = 1.0


@router.get("/api/v1/status", response_model=Status)
def status(context: Ctx) -> Any:
    """Return the numbers and sizes of products, the running services, and a text about the health of each."""
    watch = context.watch
    more = {
        "services": {} if watch is None else watch.services(),
        "health": [] if watch is None else watch.health(),
        "mission": None if context.profile is None else context.profile.name,
    }
    return jsonable(context.dpm.reports.status() | more)


@router.get("/healthz", response_class=PlainTextResponse)
def healthz() -> str:
    """Return ``ok``: the process answers."""
    return "ok\n"


@router.get("/readyz", response_class=PlainTextResponse)
def readyz(context: Ctx) -> str:
    """Return ``ready``: the store answers; with a line for each critical alarm, such as a full disk."""
    context.dpm.store.events.last_ordinal()
    check_disk(context.dpm)
    active = context.dpm.alarm_board.active()
    critical = (alarm for alarm in active if alarm["severity"] == Severity.CRITICAL)
    lines = (
        f"{alarm['kind']} of {alarm['source']}: {alarm['what']}; {alarm['remedy']}\n" for alarm in critical
    )
    return "".join(["ready\n", *lines])


@router.get("/api/v1/alarms", response_model=AlarmList)
def alarms(context: Ctx) -> Any:
    """Return the active alarms of all services, oldest first."""
    check_disk(context.dpm)
    return jsonable({"items": context.dpm.alarm_board.active()})


@router.post("/api/v1/alarms/acknowledge", response_model=AlarmBody, openapi_extra=allowed("operator"))
def acknowledge(context: Ctx, alarm: AlarmParameters) -> Any:
    """Acknowledge an active alarm: it states who did so and when, and stays active until its cause ends."""
    return jsonable(context.dpm.acknowledge(alarm.kind, alarm.source))


@router.get("/api/v1/gateways", response_model=GatewayTopicList)
def gateways(context: Ctx) -> Any:
    """Return the counters of each topic of the gateways to robots: messages received, forwarded and dropped
    by reason, the latency in the gateway, and the least age on arrival.

    ``least_age_ms`` is the least time from the stamp of a message to its arrival in the last 10 to 20 s; it
    is negative if the clock of the robot is ahead.
    """
    return jsonable({"items": gateway_topics(_gateways(context))})


@router.get("/metrics", response_class=PlainTextResponse)
def metrics(context: Ctx) -> PlainTextResponse:
    """Return counters and gauges of the DPM and, if they answer, of the orchestrator and of gateways, in
    Prometheus' text format.
    """
    lines = dpm_lines(context.dpm.reports.status()) + orchestrator_lines(_orchestrator(context))
    lines += gateway_lines(_gateways(context))
    return PlainTextResponse("\n".join(lines) + "\n", media_type="text/plain; version=0.0.4")


def _gateways(context: Context) -> dict[tuple[str, str], Any]:
    statuses: dict[tuple[str, str], Any] = {}
    if context.bus is None:
        return statuses
    with contextlib.suppress(CdffError):
        for token in context.bus.alive(keys.alive("*", "*")):
            robot, service = token.removeprefix(f"{keys.PREFIX}/").split("/@alive/")
            if service.startswith("gateway_"):
                key = keys.gateway_status(robot, service)
                with contextlib.suppress(CdffError):
                    statuses[robot, service] = context.bus.call(key, timeout_s=_METRICS_TIMEOUT_S).body()
    return statuses


def _orchestrator(context: Context) -> Any:
    if context.bus is None:
        return None
    stat = keys.orchestrator_rpc(keys.GROUND, "stat")
    try:
        return context.bus.call(stat, {"robot": "any"}, timeout_s=_METRICS_TIMEOUT_S).body()
    except CdffError:
        return None


@router.get("/api/v1/changes", response_model=Changes)
def changes(context: Ctx, parameters: Annotated[EventParameters, Query()]) -> Any:
    """Return the changes of products and frames after an ordinal; continue from ``next``."""
    return jsonable(
        context.dpm.reports.changes(parameters.since, parameters.limit, parameters.kind or CHANGES)
    )


@router.get("/api/v1/history", response_model=Changes)
def history(context: Ctx, parameters: Annotated[HistoryParameters, Query()]) -> Any:
    """Return every event after an ordinal: insertions, audit entries, the orchestrator's decisions."""
    return jsonable(
        context.dpm.reports.history(parameters.since, parameters.limit, parameters.kind, parameters.scope)
    )


@router.get(
    "/api/v1/events",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {}}, "description": "Endless stream of events"}},
)
async def events(
    context: Ctx,
    last_event_id: Annotated[
        str | None, Header(pattern=r"^[0-9]{0,18}$", description="Continue after this event")
    ] = None,
) -> StreamingResponse:
    """Return events as they occur (SSE); with ``Last-Event-ID`` all events after it."""
    store = context.dpm.store
    start = int(last_event_id) if last_event_id else await asyncio.to_thread(store.events.last_ordinal)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(_stream(context, start), media_type="text/event-stream", headers=headers)


async def _stream(context: Context, last: int) -> AsyncIterator[str]:
    """Yield events until the server stops; ``StreamingResponse`` cancels it if the client disconnects."""
    loop, news = asyncio.get_running_loop(), asyncio.Event()

    def wake() -> None:
        with contextlib.suppress(RuntimeError):  # the server's loop has ended before this stream
            loop.call_soon_threadsafe(news.set)

    def on_event(_event: Event) -> None:
        wake()

    context.dpm.events.listen(on_event)
    context.wakers.add(wake)
    try:
        yield ": connected\n\n"
        while not context.closing.is_set():
            news.clear()
            # A client that does not read blocks this generator only: events wait in the store.
            while batch := await asyncio.to_thread(context.dpm.store.events.since, last, limit=_BATCH):
                for event in batch:
                    last = event.ordinal
                    yield _line(event)
            try:
                await asyncio.wait_for(news.wait(), _KEEP_ALIVE_S)
            except TimeoutError:
                yield ": still here\n\n"
    finally:
        context.wakers.discard(wake)
        context.dpm.events.unlisten(on_event)


def _line(event: Event) -> str:
    data = json.dumps(jsonable(event.to_dict()))
    return f"id: {event.ordinal}\nevent: {event.kind}\ndata: {data}\n\n"
