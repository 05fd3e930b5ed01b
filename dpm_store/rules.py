# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rules of what may go, as data, and the statements that find what each of their bounds lets go."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from sqlalchemy import BigInteger, ColumnElement, Select, and_, case, cast, func, select

from cdff_common.clock import NS_PER_S
from cdff_common.errors import InputError
from dpm_store import schema

#: Names every type in a rule.
ANY = "*"


class Prefer(StrEnum):
    """Which products stay where not all do."""

    NEWEST = "newest"
    BEST = "best"


class Bound(StrEnum):
    """What lets a product go."""

    AGE = "age"
    COUNT = "count"
    BYTES = "bytes"
    DENSITY = "density"


@dataclass(frozen=True, slots=True)
class Rule:
    """How long products are kept. Every bound that is given holds; per robot where none is named.

    Attributes
    ----------
    product : str
        What it holds for: dem, pointcloud, …; ``*`` for all types together.
    robot, dfpc, port : str or None
        Only for products of these.
    max_age_s : float or None
        Captures that ended longer ago than this may go, counted on the mission clock.
    max_bytes : int or None
        Quota of a robot: beyond so many bytes of payloads the least preferred may go.
    max_count : int or None
        Quota of a robot: beyond so many products the least preferred may go.
    per_cell : int or None
        At most so many stay per cell of ``cell_m`` and span of ``span_s``, of one robot, type and frame.
    cell_m : float or None
        Side of the square cells in the product's frame, by the middle of its box, metres; None: no cells.
    span_s : float or None
        Length of the spans of time, by the end of capture, seconds; None: no spans.
    prefer : Prefer
        What stays: the newest, or the best by status, then resolution, then the newest; one that has a successor
        comes last.
    """

    product: str
    robot: str | None = None
    max_age_s: float | None = None
    max_bytes: int | None = None
    max_count: int | None = None
    per_cell: int | None = None
    cell_m: float | None = None
    span_s: float | None = None
    prefer: Prefer = Prefer.NEWEST
    dfpc: str | None = None
    port: str | None = None

    def __post_init__(self) -> None:
        for name in ("max_age_s", "max_bytes", "max_count", "per_cell", "cell_m", "span_s"):
            bound = getattr(self, name)
            if bound is not None and not 0 < bound < float("inf"):
                raise InputError(f"retention of {self.product}: {name}={bound}, expected more than 0")
        if (self.per_cell is None) != (self.cell_m is None and self.span_s is None):
            raise InputError(f"retention of {self.product}: per_cell goes with cell_m, span_s or both")
        if self.prefer not in list(Prefer):
            raise InputError(f"retention of {self.product}: prefer={self.prefer!r}, expected newest or best")

    def statements(self, now_ns: int) -> Iterator[tuple[Bound, Select[Any]]]:
        """For each bound a statement of the ordinals that it lets go, with a number that says by how much.

        The number is the age in seconds, the bytes that stay before it, or its rank.
        """
        p = schema.products.c
        mine: list[ColumnElement[bool]] = [p.deleted_ns.is_(None)]
        mine += [] if self.product == ANY else [p.product == self.product]
        mine += [p[name] == value for name in ("robot", "dfpc", "port") if (value := getattr(self, name)) is not None]
        if self.max_age_s is not None:
            old = p.t1_ns < now_ns - int(self.max_age_s * NS_PER_S)
            yield Bound.AGE, select(p.ordinal, (now_ns - p.t1_ns) / NS_PER_S).where(*mine, old)
        if self.max_count is not None:
            rank = func.row_number().over(partition_by=p.robot, order_by=self._order())
            yield Bound.COUNT, _beyond(mine, rank, self.max_count)
        if self.max_bytes is not None:
            used = func.sum(p.size).over(partition_by=p.robot, order_by=self._order())
            yield Bound.BYTES, _beyond(mine, used, self.max_bytes)
        if self.per_cell is not None:
            rank = func.row_number().over(partition_by=self._groups(), order_by=self._order())
            yield Bound.DENSITY, _beyond(mine, rank, self.per_cell)

    def why(self, bound: Bound, number: float, product: str, robot: str) -> str:
        """Say why the bound lets a product go."""
        whose = f"{robot} keeps" if self.product == product else f"{robot} keeps, of all types,"
        first = "best" if self.prefer is Prefer.BEST else "newest"
        if bound is Bound.AGE:
            return f"{number:.0f} s old, {product} is kept {self.max_age_s:.0f} s"
        if bound is Bound.COUNT:
            return f"number {number:.0f}, {first} first; {whose} {self.max_count} of {product}"
        if bound is Bound.BYTES:
            return f"with those before it, {first} first, {number:.0f} bytes; {whose} {self.max_bytes} of {product}"
        cell = [] if self.cell_m is None else [f"its cell of {self.cell_m:g} m"]
        span = [] if self.span_s is None else [f"its span of {self.span_s:g} s"]
        return f"number {number:.0f}, {first} first, in {' and '.join(cell + span)}, where {self.per_cell} stay"

    def _order(self) -> list[ColumnElement[Any]]:
        p = schema.products.c
        newest: list[ColumnElement[Any]] = [p.t1_ns.desc(), p.ordinal.desc()]
        if self.prefer is Prefer.NEWEST:
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
    """Largest whole number at or below; every engine has it, unlike ``floor``."""
    whole = cast(value, BigInteger)
    return whole - case((value < whole, 1), else_=0)


def _beyond(mine: list[ColumnElement[bool]], number: ColumnElement[Any], bound: int) -> Select[Any]:
    ranked = select(schema.products.c.ordinal, number.label("number")).where(and_(*mine)).subquery()
    return select(ranked.c.ordinal, ranked.c.number).where(ranked.c.number > bound)
