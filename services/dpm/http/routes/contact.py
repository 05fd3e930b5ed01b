# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/contact``: the exchange with robots over contact windows."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query

from cdff_common.bus import keys
from cdff_common.contract.queries import ContactViewParameters
from services.dpm.http.context import Ctx, jsonable

router = APIRouter(tags=["contact"])

_TIMEOUT_S = 5.0


@router.get("/api/v1/contact")
def contact(context: Ctx, parameters: Annotated[ContactViewParameters, Query()]) -> Any:
    """Return the state of the exchange with robots over contact windows.

    ``what`` selects the ``status`` of all robots, the ``plan`` (windows that have not ended), the
    ``estimate`` of the arrival of the products of ``robot``, or the ``requests`` that are kept for robots.
    """
    key = keys.dpm_rpc(keys.GROUND, "contact")
    return jsonable(context.connected().call(key, parameters.to_parameters(), timeout_s=_TIMEOUT_S).body())
