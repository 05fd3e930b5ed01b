# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pages of products in the order of any columns, by keyset: a cursor has the values of the last product."""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Sequence
from typing import Any

from sqlalchemy import ColumnElement, Connection, and_, func, or_, select

from cdff_common.errors import InputError
from dpm_store.engine import schema
from dpm_store.engine.database import dialect_of
from dpm_store.products.products import RECORD_COLUMNS
from dpm_store.products.records import Page, ProductRecord, Query
from dpm_store.search.conditions import conditions
from dpm_store.search.filters import COLUMNS

#: Value in place of a missing one: missing values are the smallest.
_LOWEST: dict[str, Any] = {"child": "", "resolution_m": -1.0, "zmin_m": -1e300, "zmax_m": -1e300}


def sorted_page(connection: Connection, query: Query, frames_revision: int) -> Page:
    """Return a page of a query with ``sort``; products with equal values are in the order of insertion.

    Raises
    ------
    InputError
        If a column is unknown, or the cursor is of another order.
    """
    columns = [(_column(name), descending) for name, descending in query.sort]
    columns.append((schema.products.c.ordinal, columns[-1][1]))
    statement = select(*(schema.products.c[name] for name in RECORD_COLUMNS), *(c for c, _ in columns[:-1]))
    statement = statement.where(*conditions(query, dialect_of(connection)))
    if query.cursor is not None:
        statement = statement.where(_after(columns, _read(query.cursor, query)))
    order = [column.desc() if descending else column for column, descending in columns]
    rows = connection.execute(statement.order_by(*order).limit(query.limit + 1)).all()
    size = len(RECORD_COLUMNS)
    items = [ProductRecord._make(row[:size]) for row in rows[: query.limit]]
    cursor = None
    if len(rows) > query.limit:
        values = [*rows[query.limit - 1][size:], items[-1].ordinal]
        text = json.dumps([[list(part) for part in query.sort], values])
        cursor = base64.urlsafe_b64encode(text.encode()).decode().rstrip("=")
    return Page(tuple(items), cursor, (), frames_revision)


def _column(name: str) -> ColumnElement[Any]:
    if name not in COLUMNS:
        raise InputError(f"sort by {name[:40]!r}: expected one of {', '.join(sorted(COLUMNS))}")
    column = schema.products.c[name]
    return func.coalesce(column, _LOWEST[name]) if name in _LOWEST else column


def _after(columns: Sequence[tuple[ColumnElement[Any], bool]], values: Sequence[Any]) -> ColumnElement[bool]:
    """Return the condition that a product follows one with these values."""
    cases = []
    for index, (column, descending) in enumerate(columns):
        equal = [columns[i][0] == values[i] for i in range(index)]
        cases.append(and_(*equal, column < values[index] if descending else column > values[index]))
    return or_(*cases)


def _read(text: str, query: Query) -> list[Any]:
    """Return the values of the sort fields in a cursor; raises InputError for a cursor of another search."""
    try:
        sort, values = json.loads(base64.urlsafe_b64decode(text + "=" * (-len(text) % 4)))
        is_right = sort == [list(part) for part in query.sort] and len(values) == len(sort) + 1
    except (binascii.Error, ValueError, TypeError, RecursionError) as error:
        raise InputError(f"cursor={text[:80]!r}: expected the cursor of a previous page") from error
    if not is_right or not all(isinstance(value, str | int | float) for value in values):
        raise InputError(f"cursor={text[:80]!r}: of a search in another order")
    return list(values)
