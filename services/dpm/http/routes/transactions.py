# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``POST /api/v1/transactions``: several changes of products and frames, all or none."""

from __future__ import annotations

import json
from typing import Any

import msgpack
from fastapi import APIRouter, Request
from pydantic import BaseModel

from cdff_common.errors import InputError
from services.dpm.http.context import Ctx, jsonable
from services.dpm.http.middleware.roles import allowed
from services.dpm.http.native_models import Items
from services.dpm.operations.dpm import Dpm
from services.dpm.operations.transactions import parse_changes

router = APIRouter(prefix="/api/v1", tags=["products"])


class Purged(BaseModel):
    """Bytes that the payload's removal freed; 0 if another product has the same content."""

    id: str
    bytes: int


@router.post(
    "/transactions",
    response_model=Items[dict[str, Any]],
    openapi_extra=allowed("operator")
    | {
        "requestBody": {
            "required": True,
            "content": {
                "application/json": {"schema": {"type": "array", "items": {"type": "object"}}},
                "application/msgpack": {},
            },
        }
    },
)
async def transact(context: Ctx, request: Request) -> dict[str, Any]:
    """Make several changes in one transaction: maps with ``do`` one of insert (MessagePack only), update,
    delete, pin, unpin, supersede, reanchor; all are made, in their order, or none.
    """
    from starlette.concurrency import run_in_threadpool

    body = _body(await request.body(), request.headers.get("content-type", ""))
    return {"items": jsonable(await run_in_threadpool(_run, context.dpm, body))}


@router.delete("/products/{product_id}/payload", response_model=Purged, openapi_extra=allowed("operator"))
def purge(context: Ctx, product_id: str) -> dict[str, Any]:
    """Remove the payload of a product that was deleted before; its metadata stay."""
    return {"id": product_id, "bytes": context.dpm.writer.purge(product_id)}


def _run(dpm: Dpm, body: Any) -> list[dict[str, Any]]:
    return dpm.writer.transact(parse_changes(body, dpm.writer.checked_product, "http"))


def _body(data: bytes, media_type: str) -> Any:
    try:
        return json.loads(data) if media_type.startswith("application/json") else msgpack.unpackb(data)
    except (ValueError, TypeError, RecursionError, msgpack.exceptions.UnpackException) as error:
        raise InputError(f"transaction: expected a list as MessagePack or JSON: {error!r}") from error
