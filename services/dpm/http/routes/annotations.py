# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``PATCH /api/v1/products/{id}``: tags, notes, pin, quality and successor of a product."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Response
from starlette.exceptions import HTTPException

from dpm_store import StaleRevisionError
from dpm_store.products.annotations import AnnotationChanges
from services.dpm.http.context import Ctx, jsonable
from services.dpm.http.middleware.conditional import required_revision
from services.dpm.http.middleware.roles import allowed
from services.dpm.http.native_models import Annotation, Items, NewAnnotation
from services.dpm.http.routes.products import etag

router = APIRouter(prefix="/api/v1/products", tags=["products"])


@router.patch("/{product_id}", response_model=NewAnnotation, openapi_extra=allowed("operator"))
def update(
    context: Ctx,
    product_id: str,
    changes: AnnotationChanges,
    response: Response,
    if_match: Annotated[str | None, Header(max_length=40, description='ETag as "r3", or *')] = None,
) -> dict[str, Any]:
    """Change the annotation of a product: 428 without ``If-Match``, 412 at another revision."""
    if if_match is None:
        raise HTTPException(428, 'If-Match is missing: send the ETag that the product was read with, as "r3"')
    new_values = changes.model_dump(exclude_unset=True)
    try:
        annotation = context.dpm.writer.update(
            product_id, new_values, required_revision(if_match), author="http"
        )
    except StaleRevisionError as error:
        raise HTTPException(412, str(error)) from error
    response.headers["ETag"] = etag(annotation)
    return {"id": product_id, **jsonable(annotation.to_dict())}


@router.get("/{product_id}/revisions", response_model=Items[Annotation])
def revisions(context: Ctx, product_id: str) -> dict[str, Any]:
    """Return all annotations of a product, oldest first."""
    context.dpm.store.get(product_id)
    return {"items": jsonable([a.to_dict() for a in context.dpm.store.annotations.history(product_id)])}
