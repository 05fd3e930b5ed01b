# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/requests``: requests to the orchestrator and its jobs, over the bus."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Request

from cdff_common.bus import keys
from cdff_common.contract.queries import RequestParameters
from cdff_common.errors import InputError
from dpm_store.history.events import check_robot
from services.dpm.http.context import Context, Ctx, jsonable
from services.dpm.http.middleware.roles import allowed

router = APIRouter(prefix="/api/v1/requests", tags=["requests"])

_LIST_TIMEOUT_S = 3.0
_MAX_DEADLINE_MS = 600_000
_EXAMPLE = {"type": "dem", "robot": "mana", "region": "circle:0,0,10", "max_age_s": 60}
#: Query parameters of a request in the OpenAPI document; all may be in the body instead.
_QUERY = [
    {"in": "query", "name": name, "required": False, "schema": schema}
    for name, schema in RequestParameters.model_json_schema()["properties"].items()
]


@router.get("")
def jobs(context: Ctx) -> Any:
    """Return the newest jobs of all robots."""
    return _jobs(context)


@router.get("/{job}")
def job(context: Ctx, job: str) -> Any:
    """Return one job by its id or the id of its request."""
    return _jobs(context, job=job)


@router.post("", openapi_extra=allowed("robot", "operator") | {"parameters": _QUERY})
def ask(
    context: Ctx, request: Request, body: Annotated[dict[str, Any] | None, Body(examples=[_EXAMPLE])] = None
) -> Any:
    """Request a product; the answer is a reference, sent when the job has ended.

    Parameters are those of ``RequestParameters``, in the query or in a JSON object with the same names, each
    once.
    """
    items = [*request.query_params.multi_items(), *_texts(body or {})]
    parameters = dict(items)
    if len(items) != len(parameters):
        raise InputError("a parameter is repeated")
    if not parameters:
        raise InputError(
            "no parameters: give them in the query, as ?type=dem&robot=mana, or as a JSON object"
        )
    checked = RequestParameters.parse(parameters)
    check_robot(checked.robot or "")
    if checked.deadline_ms > _MAX_DEADLINE_MS:
        raise InputError(f"deadline_ms={checked.deadline_ms:g}: expected at most {_MAX_DEADLINE_MS}")
    reply = context.connected().call(
        keys.orchestrator_rpc(keys.GROUND, "request"),
        {**parameters, "deliver": "reference"},
        timeout_s=checked.deadline_ms / 1000 + 1.0,
    )
    return jsonable(dict(reply.attachment))


def _jobs(context: Context, **parameters: str) -> Any:
    key = keys.orchestrator_rpc(keys.GROUND, "jobs")
    reply = context.connected().call(key, {"robot": "any", **parameters}, timeout_s=_LIST_TIMEOUT_S)
    body = reply.body()
    _mark_stored(context, body.get("jobs", [body]))
    return jsonable(body)


def _mark_stored(context: Context, jobs: list[dict[str, Any]]) -> None:
    """Add to each result with an id whether its product is stored: derived ones may be sent only."""
    results = [result for job in jobs if (result := job.get("result")) and result.get("id")]
    live = context.dpm.store.live({result["id"] for result in results})
    for result in results:
        result["stored"] = result["id"] in live


def _texts(body: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the parameters of a JSON body as query text; raises InputError for values other than text
    and numbers.
    """
    texts = []
    for name, value in body.items():
        if isinstance(value, bool) or not isinstance(value, (str, int, float)):
            raise InputError(
                f"{name[:40]}: a JSON {type(value).__name__}, expected a text or a number as in a query"
            )
        texts.append((name, value if isinstance(value, str) else repr(value)))
    return texts
