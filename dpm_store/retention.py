# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which products may go: rules as data, a plan that explains itself, and its execution.

A rule names a product (and a robot) and bounds its age or the bytes of its payloads. What is pinned stays, and so does
what a kept product was made from, through all generations: an answer can be traced back as long as it is there.
Products without a rule stay for ever.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from sqlalchemy import Connection, select

from cdff_common.clock import NS_PER_S, Clock
from cdff_common.errors import InputError
from dpm_store import schema
from dpm_store.annotations import is_pinned
from dpm_store.database import Database
from dpm_store.products import ProductTable


@dataclass(frozen=True, slots=True)
class Rule:
    """How long products are kept.

    Attributes
    ----------
    product : str
        What it holds for: dem, pointcloud, …
    robot : str or None
        Of this robot only; None for each robot by itself.
    max_age_s : float or None
        Captures that ended longer ago than this may go, counted on the mission clock.
    max_bytes : int or None
        Beyond so many bytes of payloads, per robot, the oldest may go.
    """

    product: str
    robot: str | None = None
    max_age_s: float | None = None
    max_bytes: int | None = None

    def __post_init__(self) -> None:
        for name, bound in (("max_age_s", self.max_age_s), ("max_bytes", self.max_bytes)):
            if bound is not None and not 0 < bound < float("inf"):
                raise InputError(f"retention of {self.product}: {name}={bound}, expected more than 0")


@dataclass(frozen=True, slots=True)
class Verdict:
    """What becomes of a product that a rule would let go: ``retire`` says whether it goes, ``why`` says why."""

    product_id: str
    product: str
    robot: str
    t1_ns: int
    size: int
    retire: bool
    why: str


@dataclass(frozen=True, slots=True)
class Plan:
    """Verdicts on every product that a rule would let go, oldest first."""

    verdicts: tuple[Verdict, ...]

    @property
    def retired(self) -> tuple[Verdict, ...]:
        """Those that go."""
        return tuple(v for v in self.verdicts if v.retire)

    @property
    def bytes(self) -> int:
        """Of the payloads that go; ones that share their content are counted each."""
        return sum(v.size for v in self.retired)


class Retention:
    """Plans and executes rules."""

    def __init__(self, database: Database, products: ProductTable, clock: Clock) -> None:
        self._database = database
        self._products = products
        self._clock = clock

    def plan(self, rules: Sequence[Rule]) -> Plan:
        """Say what would go and what would stay though its rule lets it go; changes nothing."""
        with self._database.read() as connection:
            return self._plan_in(connection, rules)

    def apply(self, rules: Sequence[Rule]) -> Plan:
        """Delete what may go, planned and done in one transaction; the payloads go with the next ``collect``."""
        with self._database.write() as connection:
            plan = self._plan_in(connection, rules)
            for verdict in plan.retired:
                self._products.delete_in(connection, verdict.product_id)
        return plan

    def _plan_in(self, connection: Connection, rules: Sequence[Rule]) -> Plan:
        reasons: dict[str, str] = {}
        rows = {}
        for rule in rules:
            for row, why in self._let_go(connection, rule):
                reasons.setdefault(row.id, why)
                rows[row.id] = row
        needed = _inputs_of_kept(connection, set(reasons))
        verdicts = []
        for row in sorted(rows.values(), key=lambda r: (r.t1_ns, r.ordinal)):
            kept = "pinned" if is_pinned(connection, row.id) else None
            if kept is None and row.id in needed:
                kept = f"input of {needed[row.id]}, which is kept"
            why = reasons[row.id] if kept is None else f"{kept} ({reasons[row.id]})"
            verdicts.append(Verdict(row.id, row.product, row.robot, row.t1_ns, row.size, kept is None, why))
        return Plan(tuple(verdicts))

    def _let_go(self, connection: Connection, rule: Rule) -> Iterable[tuple[_Row, str]]:
        p = schema.products.c
        statement = select(p.id, p.ordinal, p.product, p.robot, p.t1_ns, p.size).where(
            p.product == rule.product, p.deleted_ns.is_(None)
        )
        if rule.robot is not None:
            statement = statement.where(p.robot == rule.robot)
        now_ns = self._clock.now_ns()
        used: dict[str, int] = {}
        for found in connection.execute(statement.order_by(p.t1_ns.desc(), p.ordinal.desc())):
            row = _Row(*found)
            used[row.robot] = used.get(row.robot, 0) + row.size
            age_s = (now_ns - row.t1_ns) / NS_PER_S
            if rule.max_age_s is not None and age_s > rule.max_age_s:
                yield row, f"{age_s:.0f} s old, {rule.product} is kept {rule.max_age_s:.0f} s"
            elif rule.max_bytes is not None and used[row.robot] > rule.max_bytes:
                quota = f"{row.robot} keeps {rule.max_bytes} of {rule.product}"
                yield row, f"with the newer ones {used[row.robot]} bytes, {quota}"


@dataclass(frozen=True, slots=True)
class _Row:
    id: str
    ordinal: int
    product: str
    robot: str
    t1_ns: int
    size: int


def _inputs_of_kept(connection: Connection, going: set[str]) -> dict[str, str]:
    """Of the products that a rule lets go, those that a kept one was made from, with that one."""
    if not going:
        return {}
    p, v = schema.products.c, schema.provenance.c
    live = set(connection.execute(select(p.id).where(p.deleted_ns.is_(None))).scalars())
    inputs: dict[str, list[str]] = {}
    for made, used in connection.execute(select(v.product_id, v.input_id)):
        inputs.setdefault(made, []).append(used)
    pinned = set(connection.execute(select(schema.pins.c.product_id)).scalars())
    kept = [i for i in live if i not in going or i in pinned]
    needed: dict[str, str] = {}
    seen = set(kept)
    while kept:
        product_id = kept.pop()
        for used in inputs.get(product_id, ()):
            if used in going:
                needed.setdefault(used, product_id)
            if used not in seen:
                seen.add(used)
                kept.append(used)
    return needed
