# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Boolean expressions on the fields of products, as conditions in SQL.

An expression is a tree of ``Call``, ``Field``, ``Among`` and values; the functions that make one from a text
check its size and the types of its values. Fields without a value make a comparison unknown, as in SQL.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, and_, func, literal, not_, or_, select
from sqlalchemy.sql.base import ReadOnlyColumnCollection

from dpm_store.engine import schema
from dpm_store.engine.database import EMBEDDED
from dpm_store.engine.dialect import Dialect

Columns = ReadOnlyColumnCollection[str, Any]
#: Columns of products that expressions and orders may use.
COLUMNS = frozenset(
    {"id", "robot", "dfpc", "port", "product", "type_name", "codec", "frame", "child", "config_hash"}
    | {"t0_ns", "t1_ns", "inserted_ns", "size", "resolution_m", "status", "covariance_kind"}
    | {"zmin_m", "zmax_m"}
)
_COMPARISONS = {
    "=": operator.eq,
    "<>": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@dataclass(frozen=True, slots=True)
class Field:
    """A column of products, or a metric of their quality."""

    name: str
    is_metric: bool = False


@dataclass(frozen=True, slots=True)
class Call:
    """An operator and its arguments.

    Attributes
    ----------
    op : str
        ``and``, ``or``, ``not``, a comparison, ``like`` (after a backslash, ``%`` and ``_`` are
        letters), ``between``, ``in``, ``isNull`` or ``lower``.
    args : tuple
    """

    op: str
    args: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Among:
    """Condition that a product is one of these."""

    ordinals: frozenset[int]


def condition(
    expression: Any, p: Columns = schema.products.c, dialect: Dialect = EMBEDDED
) -> ColumnElement[bool]:
    """Return the condition of an expression on ``products``."""
    if isinstance(expression, bool):
        return literal(expression)
    if isinstance(expression, Among):
        is_among: ColumnElement[bool] = p.ordinal.in_(dialect.elements_of(sorted(expression.ordinals)))
        return is_among
    op, args = expression.op, expression.args
    if op in ("and", "or"):
        join = and_ if op == "and" else or_
        return join(*(condition(argument, p, dialect) for argument in args))
    if op == "not":
        return not_(condition(args[0], p, dialect))
    first = value_of(args[0], p)
    if op == "isNull":
        return first.is_(None)
    if op == "in":
        return first.in_(dialect.elements_of(list(args[1]))) if args[1] else literal(False)
    if op == "between":
        return first.between(value_of(args[1], p), value_of(args[2], p))
    if op == "like":
        return dialect.matches(first, str(args[1]))
    result: ColumnElement[bool] = _COMPARISONS[op](first, value_of(args[1], p))
    return result


def value_of(expression: Any, p: Columns = schema.products.c) -> ColumnElement[Any]:
    """Return a field, a function of one, or a value as an SQL expression."""
    if isinstance(expression, Field):
        if not expression.is_metric:
            column: ColumnElement[Any] = p[expression.name]
            return column
        m = schema.product_metrics.alias()
        of_product = select(m.c.value).where(m.c.ordinal == p.ordinal, m.c.name == expression.name)
        return of_product.scalar_subquery()
    if isinstance(expression, Call):
        return func.lower(value_of(expression.args[0], p))
    return literal(expression)
