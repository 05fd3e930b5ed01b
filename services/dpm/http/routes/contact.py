# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/contact``: the exchange with robots over contact windows."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query

from cdff_common.bus import keys
from cdff_common.bus.message import pack
from cdff_common.contract.queries import ContactFirst, ContactRequest, ContactViewParameters
from services.dpm.http.context import Context, Ctx, jsonable
from services.dpm.http.middleware.roles import allowed

router = APIRouter(prefix="/api/v1/contact", tags=["contact"])

_TIMEOUT_S = 5.0


@router.get("")
def contact(context: Ctx, parameters: Annotated[ContactViewParameters, Query()]) -> Any:
    """Return the state of the exchange with robots over contact windows.

    ``what`` selects the ``status`` of all robots, the ``plan`` (windows that have not ended), the
    ``estimate`` of the arrival of the products of ``robot``, or the ``requests`` that are kept for robots.
    """
    return _call(context, parameters.to_parameters())


@router.post("/first", openapi_extra=allowed("operator"))
def first(context: Ctx, body: ContactFirst) -> Any:
    """Have a product of a robot sent before all others from the next contact on; return its estimate."""
    return _call(context, {"robot": body.robot, "first": body.id})


@router.post("/requests", openapi_extra=allowed("operator"))
def keep_request(context: Ctx, body: ContactRequest) -> Any:
    """Keep a request for a robot that is out of contact; return its id and state at once.

    It is sent in the next contact and executed once. ``GET /api/v1/contact?what=requests&id=…`` returns its
    state and, when it is answered, the id of the product.
    """
    named = {"robot": body.robot, "expires_s": body.expires_s, "id": body.id}
    parameters = {name: value for name, value in named.items() if value is not None}
    asked = {name: str(value) for name, value in body.parameters.items()}
    return _call(context, parameters, payload=pack({"parameters": asked}))


def _call(context: Context, parameters: dict[str, Any], payload: bytes = b"") -> Any:
    key = keys.dpm_rpc(keys.GROUND, "contact")
    return jsonable(context.connected().call(key, parameters, payload=payload, timeout_s=_TIMEOUT_S).body())
