# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a query asks of the rows themselves, as SQL: everything but where they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import ColumnElement, Connection, exists, or_, select, tuple_
from sqlalchemy.sql.base import ReadOnlyColumnCollection

from dpm_store import schema
from dpm_store.annotations import carries, has_successor
from dpm_store.records import MetricBound, Order, Query, read_cursor

#: So few products are better looked at one by one.
_FEW = 1000
Columns = ReadOnlyColumnCollection[str, Any]


def conditions(query: Query, p: Columns = schema.products.c) -> list[ColumnElement[bool]]:
    """Conditions on ``products`` that hold together; the place in the order is among them but for the nearest."""
    found: list[Any] = [p.deleted_ns.is_(None)]
    if query.as_of_ns is not None:
        known = query.as_of_ns
        found = [p.inserted_ns <= known, or_(p.deleted_ns.is_(None), p.deleted_ns > known)]
    found += [carries(p.id, tag, query.as_of_ns) for tag in query.tags]
    if query.superseded is not None:
        has = has_successor(p.id, query.as_of_ns)
        found.append(has if query.superseded else ~has)
    if query.types:
        found.append(p.product.in_(query.types))
    names = ("robot", "dfpc", "port", "status", "child", "config_hash", "covariance_kind")
    wanted = {name: getattr(query, name) for name in names}
    found += [p[name] == value for name, value in wanted.items() if value is not None]
    found += [_within(bound, p.ordinal) for bound in query.metrics]
    if query.t0_ns is not None:
        found.append(p.t1_ns >= query.t0_ns)
    if query.t1_ns is not None:
        found.append(p.t0_ns <= query.t1_ns)
    if query.resolution_max_m is not None:
        found.append(p.resolution_m <= query.resolution_max_m)
    if query.resolution_above_m is not None:
        found.append(p.resolution_m > query.resolution_above_m)
    if query.inserted_after is not None:
        found.append(p.ordinal > query.inserted_after)
    if query.cursor is not None and query.order is not Order.NEAREST:
        here = tuple_(p.t1_ns, p.ordinal)
        cursor = read_cursor(query.cursor, query.order)
        place = (cursor.t1_ns, cursor.ordinal)
        found.append(here > place if query.order is Order.OLDEST else here < place)
    return found


def ordering(query: Query, p: Columns = schema.products.c) -> tuple[Any, ...]:
    """Columns to order rows by."""
    return (p.t1_ns, p.ordinal) if query.order is Order.OLDEST else (p.t1_ns.desc(), p.ordinal.desc())


def few_with(connection: Connection, bounds: Sequence[MetricBound]) -> list[int] | None:
    """Ordinals of the products within one of the bounds, where one leaves few; None where all leave many.

    Looking at those few is better then than walking through time until enough of them have come by.
    """
    m, found = schema.product_metrics, None
    for bound in bounds:
        wanted = select(m.c.ordinal).where(m.c.name == bound.name, *_bounded(m.c.value, bound)).limit(_FEW + 1)
        ordinals = list(connection.execute(wanted).scalars())
        if len(ordinals) <= _FEW and (found is None or len(ordinals) < len(found)):
            found = ordinals
    return found


def _within(bound: MetricBound, ordinal: ColumnElement[int]) -> ColumnElement[bool]:
    m = schema.product_metrics.alias()
    return exists().where(m.c.ordinal == ordinal, m.c.name == bound.name, *_bounded(m.c.value, bound))


def _bounded(value: ColumnElement[float], bound: MetricBound) -> tuple[ColumnElement[bool], ColumnElement[bool]]:
    if bound.strict:
        return value > bound.low, value < bound.high
    return value >= bound.low, value <= bound.high


#: What conditions on one column each are as text; their values have the names of the query's fields.
_PLAIN = {
    **{name: f"{name} = :{name}" for name in ("robot", "dfpc", "port", "status", "child", "config_hash")},
    "covariance_kind": "covariance_kind = :covariance_kind", "t0_ns": "t1_ns >= :t0_ns", "t1_ns": "t0_ns <= :t1_ns",
    "resolution_max_m": "resolution_m <= :resolution_max_m", "resolution_above_m": "resolution_m > :resolution_above_m",
    "inserted_after": "ordinal > :inserted_after",
}  # fmt: skip


def plain_conditions(query: Query) -> tuple[list[str], dict[str, Any]] | None:
    """As ``conditions``, as text with values, which takes a tenth of the time; None where a query asks for more.

    Tags, successors, numbers of the quality and what was known earlier need other tables, and are left to SQLAlchemy.
    """
    if query.tags or query.metrics or query.superseded is not None or query.as_of_ns is not None:
        return None
    values = {name: value for name in _PLAIN if (value := getattr(query, name)) is not None}
    found = ["deleted_ns IS NULL", *(_PLAIN[name] for name in values)]
    if query.types:
        types = {f"type_{i}": name for i, name in enumerate(query.types)}
        found.append(f"product IN ({', '.join(f':{name}' for name in types)})")
        values |= types
    if query.cursor is not None:
        cursor = read_cursor(query.cursor, query.order)
        side = ">" if query.order is Order.OLDEST else "<"
        found.append(f"(t1_ns, ordinal) {side} (:cursor_t1_ns, :cursor_ordinal)")
        values |= {"cursor_t1_ns": cursor.t1_ns, "cursor_ordinal": cursor.ordinal}
    return found, values
