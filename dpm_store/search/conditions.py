# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SQL conditions of a query on the rows of products, except its region."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, Subquery, bindparam, exists, or_, select, tuple_
from sqlalchemy.sql.base import ReadOnlyColumnCollection

from dpm_store.engine import schema
from dpm_store.engine.dialect import Dialect
from dpm_store.products.annotations import has_successor, has_tag
from dpm_store.products.records import MetricBound, Order, Query, read_cursor
from dpm_store.search.filters import condition

#: Up to this many products are read one by one.
_FEW = 1000
_EQUAL = ("robot", "dfpc", "port", "status", "child", "config_hash", "covariance_kind")
#: Column that each bound is compared with, and how.
_BOUNDS = {
    "t0_ns": ("t1_ns", operator.ge),
    "t1_ns": ("t0_ns", operator.le),
    "resolution_max_m": ("resolution_m", operator.le),
    "resolution_above_m": ("resolution_m", operator.gt),
    "inserted_after": ("ordinal", operator.gt),
}
Columns = ReadOnlyColumnCollection[str, Any]


def conditions(query: Query, dialect: Dialect, p: Columns = schema.products.c) -> list[ColumnElement[bool]]:
    """Return the conditions on ``products``, including the cursor except in the order ``nearest``."""
    clauses: list[Any] = [p.deleted_ns.is_(None)]
    if query.as_of_ns is not None:
        deleted_later = or_(p.deleted_ns.is_(None), p.deleted_ns > query.as_of_ns)
        clauses = [p.inserted_ns <= query.as_of_ns, deleted_later]
    clauses += [has_tag(p.id, tag, query.as_of_ns) for tag in query.tags]
    if query.superseded is not None:
        is_superseded = has_successor(p.id, query.as_of_ns)
        clauses.append(is_superseded if query.superseded else ~is_superseded)
    clauses += [_within(bound, p.ordinal) for bound in query.metrics]
    if query.where is not None:
        clauses.append(condition(query.where, p, dialect))
    return clauses + _comparisons(p, _values(query), query.types, query.order, _position(query))


def ordering(order: Order, p: Columns = schema.products.c) -> tuple[Any, ...]:
    """Return the columns of an order by time."""
    return (p.t1_ns, p.ordinal) if order is Order.OLDEST else (p.t1_ns.desc(), p.ordinal.desc())


def constant_statement(
    query: Query, products: Subquery, columns: tuple[str, ...]
) -> tuple[Select[Any], dict[str, Any]] | None:
    """Return a statement that is the same for all queries of this shape, and its values.

    It also restricts the end of capture to ``after_ns`` < t1 <= ``until_ns``, which are not among the values.
    None for queries by tags, metrics, successors, expressions and ``as_of_ns``.
    """
    if query.tags or query.metrics or query.superseded is not None or query.as_of_ns is not None:
        return None
    if query.where is not None:
        return None
    values, position = _values(query), _position(query)
    statement = _statement(
        products, columns, tuple(values), len(query.types), query.order, position is not None
    )
    values |= {f"type_{i}": name for i, name in enumerate(query.types)}
    if position is not None:
        values |= {"cursor_t1_ns": position[0], "cursor_ordinal": position[1]}
    return statement, values


def few_within(connection: Connection, bounds: Sequence[MetricBound]) -> list[int] | None:
    """Return the ordinals of the products within the most selective bound; None if every bound leaves many.

    Reading those few products is faster than reading products in the order of time until enough match.
    """
    m, fewest = schema.product_metrics, None
    for bound in bounds:
        matching = (
            select(m.c.ordinal).where(m.c.name == bound.name, *_bounded(m.c.value, bound)).limit(_FEW + 1)
        )
        ordinals = list(connection.execute(matching).scalars())
        if len(ordinals) <= _FEW and (fewest is None or len(ordinals) < len(fewest)):
            fewest = ordinals
    return fewest


@lru_cache(maxsize=256)
def _statement(
    products: Subquery,
    columns: tuple[str, ...],
    names: tuple[str, ...],
    types: int,
    order: Order,
    has_position: bool,
) -> Select[Any]:
    """Return the compiled form of a search, whose values are bound parameters."""
    p = products.c
    values: dict[str, Any] = {name: bindparam(name) for name in names}
    position: Any = (bindparam("cursor_t1_ns"), bindparam("cursor_ordinal")) if has_position else None
    where = _comparisons(p, values, [bindparam(f"type_{i}") for i in range(types)], order, position)
    where += [p.deleted_ns.is_(None), p.t1_ns > bindparam("after_ns"), p.t1_ns <= bindparam("until_ns")]
    return select(*(p[name] for name in columns)).where(*where).order_by(*ordering(order, p))


def _values(query: Query) -> dict[str, Any]:
    return {name: value for name in (*_EQUAL, *_BOUNDS) if (value := getattr(query, name)) is not None}


def _position(query: Query) -> tuple[int, int] | None:
    """Return time and ordinal after which a page starts; None for the first page and other orders."""
    if query.cursor is None or query.sort or query.order is Order.NEAREST:
        return None
    cursor = read_cursor(query.cursor, query.order)
    return cursor.t1_ns, cursor.ordinal


def _comparisons(
    p: Columns,
    values: Mapping[str, Any],
    types: Sequence[Any],
    order: Order,
    position: tuple[Any, Any] | None,
) -> list[ColumnElement[bool]]:
    """Return the conditions that compare columns with values or parameters."""
    clauses: list[ColumnElement[bool]] = [p[name] == values[name] for name in _EQUAL if name in values]
    if types:
        clauses.append(p.product.in_(types))
    clauses += [
        compare(p[column], values[name]) for name, (column, compare) in _BOUNDS.items() if name in values
    ]
    if position is not None:
        row, after = tuple_(p.t1_ns, p.ordinal), tuple_(*position)
        clauses.append(row > after if order is Order.OLDEST else row < after)
    return clauses


def _within(bound: MetricBound, ordinal: ColumnElement[int]) -> ColumnElement[bool]:
    m = schema.product_metrics.alias()
    return exists().where(m.c.ordinal == ordinal, m.c.name == bound.name, *_bounded(m.c.value, bound))


def _bounded(
    value: ColumnElement[float], bound: MetricBound
) -> tuple[ColumnElement[bool], ColumnElement[bool]]:
    """Return the conditions of the lower and the upper bound of a metric."""
    if bound.strict:
        return value > bound.low, value < bound.high
    return value >= bound.low, value <= bound.high
