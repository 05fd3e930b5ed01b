# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``PATCH /api/v1/products/{id}``: tags, notes, pin, judgement and successor, with the revision they were read at."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Response
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException

from dpm_store import StaleRevisionError
from services.dpm.http.conditional import required_revision
from services.dpm.http.context import Ctx, jsonable
from services.dpm.http.native_models import Annotations, NewAnnotation
from services.dpm.http.roles import allowed
from services.dpm.http.routes.products import etag

router = APIRouter(prefix="/api/v1/products", tags=["products"])


class Judgement(BaseModel):
    """Somebody's judgement of a product's quality."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    status: Annotated[str, Field(max_length=16, description="OK, DEGRADED or FAILED")]
    reasons: Annotated[list[Annotated[str, Field(max_length=200)]], Field(max_length=32)] = []
    covariance_kind: Annotated[str, Field(max_length=16)] = "none"
    metrics: Annotated[dict[Annotated[str, Field(max_length=64)], float], Field(max_length=64)] = {}


class Changes(BaseModel):
    """What is to change; a field that is left out stays, null empties ``quality`` and ``superseded_by``."""

    model_config = ConfigDict(extra="forbid", strict=True)

    tags: Annotated[list[Annotated[str, Field(max_length=64)]], Field(max_length=64)] = []
    notes: Annotated[str, Field(max_length=16_384)] = ""
    pinned: bool = False
    quality: Judgement | None = None
    superseded_by: Annotated[str, Field(max_length=36)] | None = None


@router.patch("/{product_id}", response_model=NewAnnotation, openapi_extra=allowed("operator"))
def update(
    context: Ctx, product_id: str, changes: Changes, response: Response,
    if_match: Annotated[str | None, Header(max_length=40, description='ETag as "r3", or *')] = None,
) -> dict[str, Any]:  # fmt: skip
    """Change what is said of a product: 428 without ``If-Match``, 412 where somebody else changed it since."""
    if if_match is None:
        raise HTTPException(428, 'If-Match is missing: send the ETag that the product was read with, as "r3"')
    wanted = changes.model_dump(exclude_unset=True)
    try:
        annotation = context.dpm.update(product_id, wanted, required_revision(if_match), author="http")
    except StaleRevisionError as error:
        raise HTTPException(412, str(error)) from error
    response.headers["ETag"] = etag(annotation)
    return {"id": product_id, **jsonable(annotation.to_dict())}


@router.get("/{product_id}/revisions", response_model=Annotations)
def revisions(context: Ctx, product_id: str) -> dict[str, Any]:
    """All that was said of a product, oldest first."""
    context.dpm.store.get(product_id)
    return {"items": jsonable([a.to_dict() for a in context.dpm.store.annotations.history(product_id)])}
