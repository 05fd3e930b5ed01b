# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which products may go: a plan by rules that explains itself, and its execution.

What is pinned stays, and so does what a kept product was made from, through all generations: an answer can be traced
back as long as it is there. Products without a rule stay for ever. A plan lies in temporary tables of its connection,
which the engine spills to disk, and is read as it is told: its size is bounded by the disk and not by memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import (
    BigInteger,
    Column,
    ColumnElement,
    Connection,
    Float,
    Integer,
    MetaData,
    String,
    Table,
    and_,
    exists,
    func,
    literal,
    or_,
    select,
    tuple_,
)

from cdff_common.clock import Clock
from dpm_store import schema, sqlite
from dpm_store.database import Database, Session
from dpm_store.products import ProductTable
from dpm_store.records import LATEST_NS
from dpm_store.rules import Bound, Rule

#: Verdicts that a plan holds by itself; all of them are in ``Retention.verdicts``.
TOLD = 1000
_PAGE = 1000
#: Products deleted in one transaction: others may write in between.
_BATCH = 100

_temporary = MetaData()
#: Products that a rule lets go: the first rule and bound that does, and its number.
_going = Table(
    "going",
    _temporary,
    Column("ordinal", BigInteger().with_variant(Integer, "sqlite"), primary_key=True, autoincrement=False),
    Column("rule", Integer, nullable=False),
    Column("bound", String(8), nullable=False),
    Column("number", Float, nullable=False),
    prefixes=["TEMPORARY"],
)
#: Ids of what kept products were made from, through all generations.
_needed = Table("needed", _temporary, Column("id", String(64), primary_key=True), prefixes=["TEMPORARY"])


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
    """What the rules come to.

    Attributes
    ----------
    verdicts : tuple of Verdict
        On the ``TOLD`` oldest products that a rule would let go, oldest first.
    going, staying : int
        How many go, and how many stay though their rule lets them go.
    bytes : int
        Of the payloads that go; ones that share their content are counted each.
    """

    verdicts: tuple[Verdict, ...]
    going: int
    staying: int
    bytes: int

    @property
    def retired(self) -> tuple[Verdict, ...]:
        """Those of ``verdicts`` that go."""
        return tuple(v for v in self.verdicts if v.retire)


class Retention:
    """Plans and executes rules."""

    def __init__(self, database: Database, products: ProductTable, clock: Clock) -> None:
        self._database = database
        self._products = products
        self._clock = clock

    def plan(self, rules: Sequence[Rule]) -> Plan:
        """Say what would go and what would stay though its rule lets it go; changes nothing."""
        with self._database.session() as session, session.read() as connection:
            self._lay_out(connection, rules)
            plan = self._plan(connection, rules)
            _temporary.drop_all(connection)
        return plan

    def verdicts(self, rules: Sequence[Rule]) -> Iterator[Verdict]:
        """Every verdict of a plan, oldest first, read as they are taken."""
        with self._database.session() as session, session.read() as connection:
            self._lay_out(connection, rules)
            yield from _told(connection, rules)
            _temporary.drop_all(connection)

    def apply(self, rules: Sequence[Rule]) -> Plan:
        """Delete what may go, some at a time; the payloads go with the next ``collect``.

        What is pinned, or used as an input, while it runs stays too. Returns the plan that was carried out.
        """
        with self._database.session() as session:
            with session.read() as connection:
                seen = self._lay_out(connection, rules)
                plan = self._plan(connection, rules)
            going, size = self._delete(session, seen)
            with session.read() as connection:
                _temporary.drop_all(connection)
        return Plan(plan.verdicts, going, plan.going + plan.staying - going, size)

    def _lay_out(self, connection: Connection, rules: Sequence[Rule]) -> int:
        """Fill the temporary tables; the last ordinal that they take into account."""
        _temporary.drop_all(connection)
        _temporary.create_all(connection)
        now_ns = self._clock.now_ns()
        for number, rule in enumerate(rules):
            for bound, found in rule.statements(now_ns):
                columns = found.subquery()
                ordinal, by = columns.c
                rows = select(ordinal, literal(number), literal(str(bound)), by).where(ordinal > 0)
                connection.execute(sqlite.insert_new(_going).from_select(list(_going.c), rows))
        last: int = connection.execute(select(func.max(schema.products.c.ordinal))).scalar() or 0
        _enter_needed(connection, 0)
        return last

    def _plan(self, connection: Connection, rules: Sequence[Rule]) -> Plan:
        p = schema.products.c
        joined = select(func.count(), func.coalesce(func.sum(p.size), 0)).join_from(
            _going, schema.products, p.ordinal == _going.c.ordinal
        )
        (count, _), (going, size) = connection.execute(joined).one(), connection.execute(joined.where(_may_go())).one()
        told = _told(connection, rules)
        first = tuple(verdict for verdict, _ in zip(told, range(TOLD), strict=False))
        return Plan(first, going, count - going, int(size))

    def _delete(self, session: Session, seen: int) -> tuple[int, int]:
        p = schema.products.c
        statement = (
            select(p.ordinal, p.id, p.t1_ns, p.size)
            .join_from(_going, schema.products, p.ordinal == _going.c.ordinal)
            .where(_may_go(), p.deleted_ns.is_(None)).order_by(p.t1_ns, p.ordinal).limit(_BATCH)
        )  # fmt: skip
        count, size, place = 0, 0, (-LATEST_NS, 0)
        while True:
            with session.freeing() as connection:
                newest: int = connection.execute(select(func.max(p.ordinal))).scalar() or 0
                if newest > seen:
                    _enter_needed(connection, seen)
                    seen = newest
                rows = connection.execute(statement.where(tuple_(p.t1_ns, p.ordinal) > place)).all()
                for row in rows:
                    if self._products.delete_in(connection, row.id):
                        count, size = count + 1, size + row.size
            if not rows:
                return count, size
            place = (rows[-1].t1_ns, rows[-1].ordinal)


def _enter_needed(connection: Connection, since: int) -> None:
    """Enter what products inserted after ``since`` that stay were made from."""
    if connection.execute(select(_going.c.ordinal).limit(1)).first() is None:
        return
    p, v = schema.products.c, schema.provenance.c
    stays = or_(_going.c.ordinal.is_(None), _pinned(p.id))
    inputs = (
        select(v.input_id).join_from(schema.provenance, schema.products, p.id == v.product_id)
        .outerjoin(_going, _going.c.ordinal == p.ordinal)
        .where(p.deleted_ns.is_(None), p.ordinal > since, stays)
    ).cte("inputs", recursive=True)  # fmt: skip
    inputs = inputs.union(select(v.input_id).join_from(inputs, schema.provenance, v.product_id == inputs.c.input_id))
    rows = select(inputs.c.input_id).where(inputs.c.input_id != "")
    connection.execute(sqlite.insert_new(_needed).from_select([_needed.c.id], rows))


def _told(connection: Connection, rules: Sequence[Rule]) -> Iterator[Verdict]:
    p, g = schema.products.c, _going.c
    statement = (
        select(p.ordinal, p.id, p.product, p.robot, p.t1_ns, p.size, g.rule, g.bound, g.number, ~_may_go())
        .add_columns(_pinned(p.id))
        .join_from(_going, schema.products, p.ordinal == g.ordinal).order_by(p.t1_ns, p.ordinal).limit(_PAGE)
    )  # fmt: skip
    place = (-LATEST_NS, 0)
    while rows := connection.execute(statement.where(tuple_(p.t1_ns, p.ordinal) > place)).all():
        for ordinal, product_id, product, robot, t1_ns, size, rule, bound, number, stays, pinned in rows:
            place = (t1_ns, ordinal)
            why = rules[rule].why(Bound(bound), number, product, robot)
            if stays:
                why = f"{'pinned' if pinned else _needed_by(connection, product_id)} ({why})"
            yield Verdict(product_id, product, robot, t1_ns, size, not stays, why)


def _needed_by(connection: Connection, product_id: str) -> str:
    p, v = schema.products.c, schema.provenance.c
    made = (
        select(v.product_id, p.deleted_ns).join_from(schema.provenance, schema.products, p.id == v.product_id)
        .outerjoin(_going, _going.c.ordinal == p.ordinal)
        .where(
            v.input_id == product_id,
            or_(
                p.id.in_(select(_needed.c.id)),
                and_(p.deleted_ns.is_(None), or_(_going.c.ordinal.is_(None), _pinned(p.id))),
            ),
        )
        .order_by(p.deleted_ns.is_not(None)).limit(1)
    )  # fmt: skip
    row = connection.execute(made).first()
    if row is None or row.deleted_ns is not None:
        return "input, through deleted ones, of a product which is kept"
    return f"input of {row.product_id}, which is kept"


def _may_go() -> ColumnElement[bool]:
    p = schema.products.c
    return and_(p.id.not_in(select(_needed.c.id)), ~_pinned(p.id))


def _pinned(product_id: Any) -> ColumnElement[bool]:
    return exists().where(schema.pins.c.product_id == product_id)
