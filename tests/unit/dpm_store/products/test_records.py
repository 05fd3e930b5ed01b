# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bounds and defaults of queries, and cursors of their pages."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import msgpack
import pytest

from cdff_common.contract.limits import MAX_PAGE
from cdff_common.errors import InputError
from dpm_store import Page, Query
from dpm_store.products.records import Cursor, Order, ProductRecord, read_cursor

CURSOR = Cursor(Order.NEAREST, 5_000, 7, 3, 2.5, 40)


def test_a_query_without_conditions_is_the_first_hundred_newest_products_in_the_site_frame() -> None:
    values = {f.name: getattr(Query(), f.name) for f in fields(Query)}
    non_empty = {name: value for name, value in values.items() if value not in (None, ())}
    assert non_empty == {"frame": "site", "order": Order.NEWEST, "limit": 100}


@pytest.mark.parametrize(
    "conditions",
    [
        {"limit": 1},
        {"limit": MAX_PAGE},
        {"t0_ns": 5, "t1_ns": 5},
        {"t0_ns": 6},
        {"t1_ns": 4},
        {"order": Order.NEAREST, "point": (0.0, 1e9)},
    ],
)
def test_conditions_at_a_limit_are_accepted(conditions: dict[str, Any]) -> None:
    Query(**conditions)


@pytest.mark.parametrize(
    ("conditions", "message"),
    [
        ({"limit": 0}, "limit=0"),
        ({"limit": MAX_PAGE + 1}, f"expected 1 to {MAX_PAGE}"),
        ({"t0_ns": 6, "t1_ns": 5}, "t0=6 is after t1=5"),
        ({"order": Order.NEAREST}, "expected a point or a region"),
        ({"point": (0.0, 0.0)}, "with order=nearest"),
        ({"order": Order.NEAREST, "point": (0.0, math.inf)}, "expected finite metres"),
        ({"order": Order.NEAREST, "point": (math.nan, 0.0)}, "expected finite metres"),
    ],
)
def test_conditions_beyond_a_limit_are_refused(conditions: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Query(**conditions)


@pytest.mark.parametrize("order", list(Order))
def test_a_cursor_is_read_back(order: Order) -> None:
    cursor = replace(CURSOR, order=order)
    assert read_cursor(cursor.text, order) == cursor
    assert "=" not in cursor.text
    first = Cursor(order, 5_000, 7)
    assert read_cursor(first.text, order) == Cursor(order, 5_000, 7, 0, 0.0, 0)


@pytest.mark.parametrize(
    "fields",
    [
        {"order": Order.NEWEST},
        {"distance_m": -0.1},
        {"distance_m": math.inf},
        {"distance_m": math.nan},
        {"frames_revision": -1},
        {"count": -1},
        {"count": (1 << 40) + 1},
    ],
)
def test_a_cursor_of_another_search_is_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="made by a search in another order than nearest"):
        read_cursor(replace(CURSOR, **fields).text, Order.NEAREST)


def test_a_cursor_at_its_bounds_is_accepted() -> None:
    for changes in ({"count": 1 << 40}, {"count": 0}, {"distance_m": 0.0}, {"frames_revision": 0}):
        assert read_cursor(replace(CURSOR, **changes).text, Order.NEAREST) == replace(CURSOR, **changes)


def test_a_malformed_cursor_is_refused() -> None:
    for text in ("", "x", CURSOR.text[:-3], CURSOR.text + "AAAA"):
        with pytest.raises(InputError, match="expected the cursor of a previous page"):
            read_cursor(text, Order.NEAREST)


def test_a_page_states_distances_only_in_the_order_nearest() -> None:
    page = Page((), "c", ("a/b",), 4)
    plain = {"cursor": "c", "unplaced_frames": ["a/b"], "frames_revision": 4}
    assert page.to_dict() == plain
    assert replace(page, distances_m=(1.0, 2.0)).to_dict() == plain | {"distances_m": [1.0, 2.0]}


@pytest.mark.parametrize(
    ("type_name", "header", "size", "decoded_bytes"),
    [
        ("ElevationMap", {"box_m": [0, 0, 0, 10, 20, 1], "resolution_m": 0.1}, 200_000, 40 * 20_000),
        ("NavigationMap", {"box_m": [0, 0, 0, 10, 20, 0], "resolution_m": 0.1}, 200_000, 24 * 20_000),
        ("ElevationMap", {"box_m": [0, 0, 0, 10, 20, 1], "resolution_m": 0.1}, 900_000, 900_000),
        ("ElevationMap", {"box_m": [0, 0, 0, 10, 20, 1], "resolution_m": 1e-4}, 1_000, 64_000),
        ("ElevationMap", {"box_m": [0, 0, 0, 10, 20, 1]}, 1_000, 1_000),
        ("Pointcloud", {"box_m": [0, 0, 0, 10, 20, 1], "resolution_m": 0.1}, 1_000, 1_000),
    ],
)
def test_the_size_of_a_decoded_map_follows_from_its_cells(
    type_name: str, header: dict[str, Any], size: int, decoded_bytes: int
) -> None:
    record = ProductRecord(
        ordinal=1,
        robot="mana",
        dfpc="digital_elevation_mapping",
        port="map",
        product="dem",
        type_name=type_name,
        codec="uper",
        id="a",
        t1_ns=0,
        packed_header=msgpack.packb(header),
        size=size,
        inserted_ns=0,
    )
    assert record.decoded_bytes == decoded_bytes
