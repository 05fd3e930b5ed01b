# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/requests``: the orchestrator's jobs, over the bus; a request is answered by reference."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request

from cdff_common.bus import keys
from cdff_common.errors import InputError
from services.dpm.http.context import Ctx, jsonable

router = APIRouter(prefix="/api/v1/requests", tags=["requests"])

_LIST_TIMEOUT_S = 3.0
_MAX_DEADLINE_MS = 600_000


@router.get("")
def jobs(context: Ctx) -> Any:
    """The newest jobs of all robots."""
    bus = context.connected()
    body = bus.call(keys.orchestrator_rpc(keys.GROUND, "jobs"), {"robot": "any"}, timeout_s=_LIST_TIMEOUT_S).body()
    return jsonable(body)


@router.get("/{job}")
def job(context: Ctx, job: str) -> Any:
    """One job by its id or its request's."""
    asked = {"robot": "any", "job": job}
    bus = context.connected()
    return jsonable(bus.call(keys.orchestrator_rpc(keys.GROUND, "jobs"), asked, timeout_s=_LIST_TIMEOUT_S).body())


@router.post("")
def ask(context: Ctx, request: Request) -> Any:
    """Ask for a product with contract §5's parameters as query parameters; answers when it is done, by reference."""
    given = request.query_params.multi_items()
    parameters = dict(given)
    if len(given) != len(parameters):
        raise InputError("a parameter is repeated")
    text = parameters.get("deadline_ms", "8000")
    if not text.isdigit() or int(text) > _MAX_DEADLINE_MS:
        raise InputError(f"deadline_ms={text[:20]!r}: expected a whole number up to {_MAX_DEADLINE_MS}")
    reply = context.connected().call(
        keys.orchestrator_rpc(keys.GROUND, "request"), {**parameters, "deliver": "reference"},
        timeout_s=int(text) / 1000 + 1.0,
    )  # fmt: skip
    return jsonable(dict(reply.attachment))
