# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/requests``: the orchestrator's jobs, over the bus; a request is answered by reference."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Request

from cdff_common.bus import keys
from cdff_common.errors import InputError
from dpm_store.actor import check_robot
from services.dpm.http.context import Ctx, jsonable
from services.dpm.http.roles import allowed

router = APIRouter(prefix="/api/v1/requests", tags=["requests"])

_LIST_TIMEOUT_S = 3.0
_MAX_DEADLINE_MS = 600_000
_EXAMPLE = {"type": "dem", "robot": "mana", "region": "circle:0,0,10", "max_age_s": 60}
#: Parameters of contract §5, as OpenAPI describes ones of any names.
_ANY: dict[str, Any] = {
    "in": "query", "name": "parameters", "style": "form", "explode": True,
    "schema": {"type": "object", "additionalProperties": {"type": "string"}},
}  # fmt: skip


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


@router.post("", openapi_extra=allowed("robot", "operator") | {"parameters": [_ANY]})
def ask(
    context: Ctx, request: Request, body: Annotated[dict[str, Any] | None, Body(examples=[_EXAMPLE])] = None
) -> Any:
    """Ask for a product; answers when it is done, by reference.

    Parameters are contract §5's, in the query or as a JSON object of the same names, each in one of them.
    """
    given = [*request.query_params.multi_items(), *_texts(body or {})]
    parameters = dict(given)
    if len(given) != len(parameters):
        raise InputError("a parameter is repeated")
    if not parameters:
        raise InputError("no parameters: give them in the query, as ?type=dem&robot=mana, or as a JSON object")
    check_robot(parameters.get("robot", ""))
    text = parameters.get("deadline_ms", "8000")
    if not text.isdigit() or int(text) > _MAX_DEADLINE_MS:
        raise InputError(f"deadline_ms={text[:20]!r}: expected a whole number up to {_MAX_DEADLINE_MS}")
    reply = context.connected().call(
        keys.orchestrator_rpc(keys.GROUND, "request"), {**parameters, "deliver": "reference"},
        timeout_s=int(text) / 1000 + 1.0,
    )  # fmt: skip
    return jsonable(dict(reply.attachment))


def _texts(body: dict[str, Any]) -> list[tuple[str, str]]:
    """The parameters of a JSON body as they would stand in a query; raises InputError on what is no text or number."""
    texts = []
    for name, value in body.items():
        if isinstance(value, bool) or not isinstance(value, (str, int, float)):
            raise InputError(f"{name[:40]}: a JSON {type(value).__name__}, expected a text or a number as in a query")
        texts.append((name, value if isinstance(value, str) else repr(value)))
    return texts
