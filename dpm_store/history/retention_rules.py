# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Retention rules as data, and the statements that select products beyond their bounds."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from typing import Any

from pydantic import ValidationError
from sqlalchemy import BigInteger, ColumnElement, Select, and_, case, cast, func, select

from cdff_common.clock import NS_PER_S
from cdff_common.contract.parameters import validation_message
from cdff_common.errors import InputError
from cdff_common.interfaces.profile import Retention
from dpm_store.engine import schema

#: Matches every type in a rule.
ANY = "*"


class Bound(StrEnum):
    """Kind of a bound of a rule."""

    AGE = "age"
    COUNT = "count"
    BYTES = "bytes"
    DENSITY = "density"


class Rule(Retention):
    """A retention rule of a profile; every bound that is set applies.

    Captures that ended longer ago than ``max_age_s`` by the mission clock may be deleted, and of the products
    beyond a quota the least preferred ones. ``per_cell`` holds for each robot, type and frame; cells are in
    the product's frame, by the centre of its box. ``prefer="best"`` orders by status, then resolution, then
    time; products with a successor come last.
    """

    def __init__(self, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            raise InputError(f"retention rule: {validation_message(dict(error.errors()[0]))}") from error

    def statements(self, now_ns: int) -> Iterator[tuple[Bound, Select[Any]]]:
        """Yield each bound with a statement that selects the ordinals beyond it, and a number for each.

        The number is the age in seconds, the cumulated bytes, or the rank.
        """
        p = schema.products.c
        matching: list[ColumnElement[bool]] = [p.deleted_ns.is_(None)]
        matching += [] if self.product == ANY else [p.product == self.product]
        matching += [
            p[name] == value
            for name in ("robot", "dfpc", "port")
            if (value := getattr(self, name)) is not None
        ]
        if self.max_age_s is not None:
            is_old = p.t1_ns < now_ns - int(self.max_age_s * NS_PER_S)
            yield Bound.AGE, select(p.ordinal, (now_ns - p.t1_ns) / NS_PER_S).where(*matching, is_old)
        if self.max_count is not None:
            rank = func.row_number().over(partition_by=p.robot, order_by=self._order())
            yield Bound.COUNT, _beyond(matching, rank, self.max_count)
        if self.max_bytes is not None:
            cumulated_bytes = func.sum(p.size).over(partition_by=p.robot, order_by=self._order())
            yield Bound.BYTES, _beyond(matching, cumulated_bytes, self.max_bytes)
        if self.per_cell is not None:
            rank = func.row_number().over(partition_by=self._groups(), order_by=self._order())
            yield Bound.DENSITY, _beyond(matching, rank, self.per_cell)

    def why(self, bound: Bound, number: float, product: str, robot: str) -> str:
        """Return the reason why a product is beyond the bound."""
        quota = f"{robot} keeps" if self.product == product else f"{robot} keeps, of all types,"
        first = "best" if self.prefer == "best" else "newest"
        if bound is Bound.AGE:
            return f"{number:.0f} s old, {product} is kept {self.max_age_s:.0f} s"
        if bound is Bound.COUNT:
            return f"number {number:.0f}, {first} first; {quota} {self.max_count} of {product}"
        if bound is Bound.BYTES:
            cumulated = f"{number:.0f} bytes together with preferred ones, {first} first"
            return f"{cumulated}; {quota} {self.max_bytes} of {product}"
        cell = [] if self.cell_m is None else [f"its cell of {self.cell_m:g} m"]
        span = [] if self.span_s is None else [f"its span of {self.span_s:g} s"]
        return (
            f"number {number:.0f}, {first} first, in {' and '.join(cell + span)}, where {self.per_cell} stay"
        )

    def _order(self) -> list[ColumnElement[Any]]:
        p = schema.products.c
        newest: list[ColumnElement[Any]] = [p.t1_ns.desc(), p.ordinal.desc()]
        if self.prefer == "newest":
            return newest
        superseded = p.id.in_(select(schema.supersessions.c.product_id))
        status = case((p.status == "OK", 0), (p.status == "DEGRADED", 1), else_=2)
        return [case((superseded, 1), else_=0), status, p.resolution_m.asc().nulls_last(), *newest]

    def _groups(self) -> list[ColumnElement[Any]]:
        p = schema.products.c
        groups: list[ColumnElement[Any]] = [p.robot, p.product, p.frame]
        if self.cell_m is not None:
            groups += [_floor((low + high) / (2.0 * self.cell_m)) for low, high in _PLANE]
        if self.span_s is not None:
            groups.append(_floor(p.t1_ns / (self.span_s * NS_PER_S)))
        return groups


_PLANE = (
    (schema.products.c.xmin_m, schema.products.c.xmax_m),
    (schema.products.c.ymin_m, schema.products.c.ymax_m),
)


def _floor(value: ColumnElement[Any]) -> ColumnElement[Any]:
    """Return the largest whole number at or below; not every engine has ``floor``."""
    truncated = cast(value, BigInteger)
    return truncated - case((value < truncated, 1), else_=0)


def _beyond(matching: list[ColumnElement[bool]], number: ColumnElement[Any], bound: int) -> Select[Any]:
    ranked = select(schema.products.c.ordinal, number.label("number")).where(and_(*matching)).subquery()
    return select(ranked.c.ordinal, ranked.c.number).where(ranked.c.number > bound)
