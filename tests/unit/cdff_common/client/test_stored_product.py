# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Typed results of a search."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from cdff_common.client import StoredProduct
from cdff_common.errors import CodecError
from cdff_common.interfaces.product import Header, product_id

ITEM = {
    **Header(product_id("mana", "d", "p", 0, 0, ""), 0, 0, 1_000_000_000, "site", "d/i/1").to_dict(),
    "robot": "mana",
    "dfpc": "d",
    "port": "p",
    "product": "dem",
    "type_name": "ElevationMap",
    "codec": "uper",
    "size": 12,
    "inserted_ns": 2_000_000_000,
}


def test_a_result_has_typed_fields_and_datetimes() -> None:
    product = StoredProduct.from_dict(ITEM)
    assert (product.product, product.size, product.header.frame) == ("dem", 12, "site")
    assert product.captured == datetime(1970, 1, 1, 0, 0, 1, tzinfo=UTC)
    assert product.inserted == datetime(1970, 1, 1, 0, 0, 2, tzinfo=UTC)
    assert dict(product) == ITEM
    assert len(repr(product)) < 200


def test_a_malformed_item_is_named() -> None:
    with pytest.raises(CodecError, match="size"):
        StoredProduct.from_dict({k: v for k, v in ITEM.items() if k != "size"})
