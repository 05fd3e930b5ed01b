# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products for tests of the store."""

from __future__ import annotations

from typing import Any

from cdff_common.interfaces.product import Header, product_id
from dpm_store import Insertion, NewProduct, Store

NAMES = {
    "robot": "mana",
    "dfpc": "digital_elevation_mapping",
    "port": "map",
    "product": "dem",
    "type_name": "ElevationMap",
}


def header(seq: int, **fields: Any) -> Header:
    """Return a header with an id made from ``seq``; the capture time is ``seq`` seconds by default."""
    t1_ns = fields.pop("t1_ns", seq * 1_000_000_000)
    defaults = {"frame": "site", "producer": "test", "t0_ns": t1_ns, "config_hash": "c"} | fields
    return Header(id=product_id("mana", "test", "map", t1_ns, seq, "c"), seq=seq, t1_ns=t1_ns, **defaults)


def put(store: Store, product_header: Header, payload: bytes = b"payload", **other: Any) -> Insertion:
    """Insert a product, of ``mana`` by default."""
    return store.put_all([NewProduct(product_header, payload, **{**NAMES, **other})])[0]
