# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/product_types``: the types of products, their titles and formats."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel

from cdff_common.contract.products import product_types
from services.dpm.http.native_models import Items
from services.dpm.rendering.convert import file_formats
from services.dpm.rendering.pictures import DRAWN_TYPES

router = APIRouter(prefix="/api/v1/product_types", tags=["products"])


class ProductTypeAnswer(BaseModel):
    """A product type; ``type_name`` is the ASN.1 type of its payloads, null if any type is accepted."""

    name: str
    title: str
    type_name: str | None
    other_types: list[str]
    file_formats: list[str]
    spatial: bool
    requestable: bool
    thumbnail: bool


@router.get("", response_model=Items[ProductTypeAnswer])
def all_types() -> dict[str, Any]:
    """Return the product types that are stored, searched and requested here."""
    items = [
        {
            "name": product.name,
            "title": product.title,
            "type_name": product.type_name,
            "other_types": product.other_types,
            "file_formats": list(file_formats(product.type_name or "")),
            "spatial": product.is_spatial,
            "requestable": product.is_requestable and product.type_name is not None,
            "thumbnail": product.type_name in (*DRAWN_TYPES, "Frame"),
        }
        for product in product_types().values()
    ]
    return {"items": items}
