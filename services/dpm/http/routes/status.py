# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How the DPM is: status, health, metrics, and the stream of events."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request
from fastapi.responses import PlainTextResponse, StreamingResponse

from cdff_common.bus import keys
from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError
from dpm_store import Event
from dpm_store.events import CHANGES
from services.dpm.http.context import Context, Ctx, jsonable
from services.dpm.http.metrics import dpm_lines, orchestrator_lines
from services.dpm.http.native_models import Changes, Status

router = APIRouter(tags=["status"])

_KEEP_ALIVE_S = 15.0
#: How often a quiet stream looks whether its caller, or the server, has gone.
_LOOK_S = 0.5
#: Events that are read at once; each may take 64 kB.
_BATCH = 16
_METRICS_TIMEOUT_S = 1.0


@router.get("/api/v1/status", response_model=Status)
def status(context: Ctx) -> dict[str, Any]:
    """Counts and sizes, and the services that are alive."""
    services = context.watch.services() if context.watch is not None else {}
    mission = context.profile.name if context.profile is not None else None
    data: dict[str, Any] = jsonable(context.dpm.status() | {"services": services, "mission": mission})
    return data


@router.get("/healthz", response_class=PlainTextResponse)
def healthz() -> str:
    """The process answers."""
    return "ok\n"


@router.get("/readyz", response_class=PlainTextResponse)
def readyz(context: Ctx) -> str:
    """The store answers."""
    context.dpm.store.events.last_ordinal()
    return "ready\n"


@router.get("/metrics", response_class=PlainTextResponse)
def metrics(context: Ctx) -> PlainTextResponse:
    """Counters and gauges of the DPM and, where it answers, of the orchestrator, in Prometheus' text format."""
    lines = dpm_lines(context.dpm.status()) + orchestrator_lines(_orchestrator(context))
    return PlainTextResponse("\n".join(lines) + "\n", media_type="text/plain; version=0.0.4")


def _orchestrator(context: Context) -> dict[str, Any] | None:
    if context.bus is None:
        return None
    try:
        body: dict[str, Any] = context.bus.call(
            keys.orchestrator_rpc(keys.GROUND, "stat"), {"robot": "any"}, timeout_s=_METRICS_TIMEOUT_S
        ).body()
    except CdffError:
        return None
    return body


@router.get("/api/v1/changes", response_model=Changes)
def changes(
    context: Ctx, since: Annotated[int, Query(ge=0, le=2**62)] = 0, limit: Annotated[int, Query(ge=1, le=1000)] = 1000,
    kind: Annotated[str | None, Query(max_length=100, description=f"Some of {', '.join(CHANGES)}")] = None,
) -> dict[str, Any]:  # fmt: skip
    """What has changed in products and frames after an event's ordinal; go on from ``next``."""
    kinds = CHANGES if kind is None else tuple(kind.split(","))
    data: dict[str, Any] = jsonable(context.dpm.changes(since, limit, kinds))
    return data


@router.get("/api/v1/history", response_model=Changes)
def history(
    context: Ctx, since: Annotated[int, Query(ge=0, le=2**62)] = 0, limit: Annotated[int, Query(ge=1, le=1000)] = 1000,
    kind: Annotated[str | None, Query(max_length=100, description="job, activation, …; several with commas")] = None,
    scope: Annotated[str | None, Query(max_length=64, description="A robot's id, or ground.")] = None,
) -> dict[str, Any]:  # fmt: skip
    """Everything that happened after an event's ordinal: insertions, audit entries, the orchestrator's decisions."""
    kinds = () if kind is None else tuple(kind.split(","))
    data: dict[str, Any] = jsonable(context.dpm.history(since, limit, kinds, scope))
    return data


@router.get(
    "/api/v1/events", response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {}}, "description": "Events without end"}},
)  # fmt: skip
async def events(
    context: Ctx, request: Request,
    last_event_id: Annotated[str | None, Header(pattern=r"^[0-9]{0,18}$", description="Go on after this")] = None,
) -> StreamingResponse:  # fmt: skip
    """Events as they happen (SSE); with ``Last-Event-ID`` from there on, nothing left out."""
    store = context.dpm.store
    start = int(last_event_id) if last_event_id else await asyncio.to_thread(store.events.last_ordinal)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(_stream(context, request, start), media_type="text/event-stream", headers=headers)


async def _stream(context: Context, request: Request, last: int) -> AsyncIterator[str]:
    loop, news = asyncio.get_running_loop(), asyncio.Event()

    def on_event(_event: Event) -> None:
        with contextlib.suppress(RuntimeError):  # the server's loop has ended before this stream
            loop.call_soon_threadsafe(news.set)

    context.dpm.listen(on_event)
    try:
        yield ": connected\n\n"
        spoke_s = monotonic_s()
        while not (context.closing.is_set() or await request.is_disconnected()):
            news.clear()
            # A caller who does not read holds up this generator and nothing else: events wait in the store, not here.
            while batch := await asyncio.to_thread(context.dpm.store.events.since, last, limit=_BATCH):
                for event in batch:
                    last = event.ordinal
                    yield _line(event)
                spoke_s = monotonic_s()
            if monotonic_s() - spoke_s >= _KEEP_ALIVE_S:
                yield ": still here\n\n"
                spoke_s = monotonic_s()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(news.wait(), min(_KEEP_ALIVE_S, _LOOK_S))
    finally:
        context.dpm.unlisten(on_event)


def _line(event: Event) -> str:
    body = jsonable({"stamp_ns": event.stamp_ns, "scope": event.scope, "kind": event.kind, **event.body})
    return f"id: {event.ordinal}\nevent: {event.kind}\ndata: {json.dumps(body)}\n\n"
