# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Retention: planning by rules, with a reason for each product, and execution of the plan.

Pinned products and the inputs of kept products through all generations stay, so that results remain
traceable. Products without a rule stay. A plan is stored in temporary tables of its connection, which the
engine moves to disk, and is read in pages: its size is limited by the disk and not by memory.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import (
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
from cdff_common.contract.limits import LATEST_NS
from dpm_store.engine import schema
from dpm_store.engine.database import Database, Session, dialect_of
from dpm_store.history.retention_rules import Bound, Rule
from dpm_store.products.products import ProductTable

#: Decisions in a plan; ``Retention.decisions`` returns all of them.
MAX_DECISIONS = 1000
#: Products that are read from the database at once.
_PAGE = 1000
#: Products deleted in one transaction, so that others can write in between.
_BATCH = 100

_temporary = MetaData()
#: Products that a rule selects: the first rule and bound that selects it, and its number.
_selected = Table(
    "selected",
    _temporary,
    Column("ordinal", Integer, primary_key=True, autoincrement=False),
    Column("rule", Integer, nullable=False),
    Column("bound", String(8), nullable=False),
    Column("number", Float, nullable=False),
    prefixes=["TEMPORARY"],
)
#: Ids of selected products and of those derived from them, through all generations.
_related = Table("related", _temporary, Column("id", String(64), primary_key=True), prefixes=["TEMPORARY"])
#: Ids of related inputs of kept products, through all generations.
_needed = Table("needed", _temporary, Column("id", String(64), primary_key=True), prefixes=["TEMPORARY"])


@dataclass(frozen=True, slots=True)
class RetentionDecision:
    """Decision about a product that a rule selects: whether to retire it, and the reason."""

    id: str
    product: str
    robot: str
    t1_ns: int
    size: int
    retire: bool
    why: str


@dataclass(frozen=True, slots=True)
class RetentionPlan:
    """Effect of rules on the products.

    Attributes
    ----------
    decisions : tuple of RetentionDecision
        Decisions on the ``MAX_DECISIONS`` oldest products that a rule selects, oldest first.
    to_delete, to_keep : int
        Number of products to delete, and of products that stay although a rule selects them.
    bytes : int
        Bytes of the payloads to delete; a shared payload counts for each product.
    """

    decisions: tuple[RetentionDecision, ...]
    to_delete: int
    to_keep: int
    bytes: int

    @property
    def retired(self) -> tuple[RetentionDecision, ...]:
        """The decisions to retire a product."""
        return tuple(v for v in self.decisions if v.retire)


class Retention:
    """Planning and execution of retention rules."""

    def __init__(self, database: Database, products: ProductTable, clock: Clock) -> None:
        self._database = database
        self._products = products
        self._clock = clock

    def plan(self, rules: Sequence[Rule]) -> RetentionPlan:
        """Return the plan of rules without executing it."""
        with self._database.session() as session, session.read() as connection:
            self._fill(connection, rules)
            plan = self._plan(connection, rules)
            _temporary.drop_all(connection)
        return plan

    def decisions(self, rules: Sequence[Rule]) -> Iterator[RetentionDecision]:
        """Return every decision of a plan, oldest first, read in pages."""
        with self._database.session() as session, session.read() as connection:
            self._fill(connection, rules)
            yield from _decisions(connection, rules)
            _temporary.drop_all(connection)

    def apply(self, rules: Sequence[Rule]) -> RetentionPlan:
        """Delete the retired products in batches and return the executed plan.

        Products that are pinned or used as an input meanwhile stay. ``collect`` removes the payloads.
        """
        with self._database.session() as session:
            with session.read() as connection:
                last = self._fill(connection, rules)
                plan = self._plan(connection, rules)
            deleted, size = self._delete(session, last)
            with session.read() as connection:
                _temporary.drop_all(connection)
        return RetentionPlan(plan.decisions, deleted, plan.to_delete + plan.to_keep - deleted, size)

    def _fill(self, connection: Connection, rules: Sequence[Rule]) -> int:
        """Fill the temporary tables; return the last ordinal that they include."""
        _temporary.drop_all(connection)
        _temporary.create_all(connection)
        now_ns = self._clock.now_ns()
        for number, rule in enumerate(rules):
            for bound, statement in rule.statements(now_ns):
                columns = statement.subquery()
                ordinal, number_column = columns.c
                rows = select(ordinal, literal(number), literal(str(bound)), number_column).where(ordinal > 0)
                connection.execute(
                    dialect_of(connection).insert_or_ignore(_selected).from_select(list(_selected.c), rows)
                )
        p = schema.products.c
        selected = select(p.id).join_from(_selected, schema.products, p.ordinal == _selected.c.ordinal)
        connection.execute(
            dialect_of(connection).insert_or_ignore(_related).from_select([_related.c.id], selected)
        )
        last: int = connection.execute(select(func.max(p.ordinal))).scalar() or 0
        _insert_inputs_of_kept(connection, 0)
        return last

    def _plan(self, connection: Connection, rules: Sequence[Rule]) -> RetentionPlan:
        """Return the plan of the rules: the first decisions, and counts of all."""
        p = schema.products.c
        joined = select(func.count(), func.coalesce(func.sum(p.size), 0)).join_from(
            _selected, schema.products, p.ordinal == _selected.c.ordinal
        )
        (count, _), (to_delete, size) = (
            connection.execute(joined).one(),
            connection.execute(joined.where(_may_retire())).one(),
        )
        decisions = tuple(itertools.islice(_decisions(connection, rules), MAX_DECISIONS))
        return RetentionPlan(decisions, to_delete, count - to_delete, int(size))

    def _delete(self, session: Session, last: int) -> tuple[int, int]:
        """Delete the products that may retire, in batches; return their number and bytes."""
        p = schema.products.c
        statement = (
            select(p.ordinal, p.id, p.t1_ns, p.size)
            .join_from(_selected, schema.products, p.ordinal == _selected.c.ordinal)
            .where(_may_retire(), p.deleted_ns.is_(None))
            .order_by(p.t1_ns, p.ordinal)
            .limit(_BATCH)
        )
        count, size, position = 0, 0, (-LATEST_NS, 0)
        while True:
            with session.deletion() as connection:
                newest: int = connection.execute(select(func.max(p.ordinal))).scalar() or 0
                if newest > last:
                    _insert_inputs_of_kept(connection, last)
                    last = newest
                rows = connection.execute(statement.where(tuple_(p.t1_ns, p.ordinal) > position)).all()
                for row in rows:
                    if self._products.delete(row.id, connection=connection):
                        count, size = count + 1, size + row.size
            if not rows:
                return count, size
            position = (rows[-1].t1_ns, rows[-1].ordinal)


def _insert_inputs_of_kept(connection: Connection, since: int) -> None:
    """Insert the inputs of the staying products that were inserted after ``since``.

    Only products derived from selected ones are visited: the time depends on their number and not on that of
    all products.
    """
    if connection.execute(select(_selected.c.ordinal).limit(1)).first() is None:
        return
    p, v, insert = schema.products.c, schema.provenance.c, dialect_of(connection).insert_or_ignore
    is_related = v.input_id.in_(select(_related.c.id))
    if since:  # few products are newer: only their inputs are read
        first = select(p.id).where(p.ordinal > since, exists().where(v.product_id == p.id, is_related))
    else:
        first = select(v.product_id.label("id")).where(is_related)
    derived = first.cte("derived", recursive=True)
    derived = derived.union(
        select(v.product_id).join_from(derived, schema.provenance, v.input_id == derived.c.id)
    )
    rows = select(derived.c.id).where(derived.c.id != "")
    connection.execute(insert(_related).from_select([_related.c.id], rows))

    stays = or_(_selected.c.ordinal.is_(None), _pinned_condition(p.id))
    inputs = (
        select(v.input_id)
        .join_from(_related, schema.products, p.id == _related.c.id)
        .outerjoin(_selected, _selected.c.ordinal == p.ordinal)
        .join(schema.provenance, v.product_id == p.id)
        .where(p.deleted_ns.is_(None), p.ordinal > since, stays, is_related)
    ).cte("inputs", recursive=True)
    inputs = inputs.union(
        select(v.input_id)
        .join_from(inputs, schema.provenance, v.product_id == inputs.c.input_id)
        .where(is_related)
    )
    rows = select(inputs.c.input_id).where(inputs.c.input_id != "")
    connection.execute(insert(_needed).from_select([_needed.c.id], rows))


def _decisions(connection: Connection, rules: Sequence[Rule]) -> Iterator[RetentionDecision]:
    """Yield the decision about each selected product, in order of its time, with the reason."""
    p, g = schema.products.c, _selected.c
    statement = (
        select(
            p.ordinal, p.id, p.product, p.robot, p.t1_ns, p.size, g.rule, g.bound, g.number, ~_may_retire()
        )
        .add_columns(_pinned_condition(p.id))
        .join_from(_selected, schema.products, p.ordinal == g.ordinal)
        .order_by(p.t1_ns, p.ordinal)
        .limit(_PAGE)
    )
    position = (-LATEST_NS, 0)
    while rows := connection.execute(statement.where(tuple_(p.t1_ns, p.ordinal) > position)).all():
        for ordinal, product_id, product, robot, t1_ns, size, rule, bound, number, stays, pinned in rows:
            position = (t1_ns, ordinal)
            why = rules[rule].why(Bound(bound), number, product, robot)
            if stays:
                why = f"{'pinned' if pinned else _needed_by(connection, product_id)} ({why})"
            yield RetentionDecision(product_id, product, robot, t1_ns, size, not stays, why)


def _needed_by(connection: Connection, product_id: str) -> str:
    """Return the reason for which an input is kept: the product that needs it."""
    p, v = schema.products.c, schema.provenance.c
    derived = (
        select(v.product_id, p.deleted_ns)
        .join_from(schema.provenance, schema.products, p.id == v.product_id)
        .outerjoin(_selected, _selected.c.ordinal == p.ordinal)
        .where(
            v.input_id == product_id,
            or_(
                p.id.in_(select(_needed.c.id)),
                and_(p.deleted_ns.is_(None), or_(_selected.c.ordinal.is_(None), _pinned_condition(p.id))),
            ),
        )
        .order_by(p.deleted_ns.is_not(None))
        .limit(1)
    )
    row = connection.execute(derived).first()
    if row is None or row.deleted_ns is not None:
        return "input, through deleted ones, of a product which is kept"
    return f"input of {row.product_id}, which is kept"


def _may_retire() -> ColumnElement[bool]:
    p = schema.products.c
    return and_(p.id.not_in(select(_needed.c.id)), ~_pinned_condition(p.id))


def _pinned_condition(product_id: Any) -> ColumnElement[bool]:
    return exists().where(schema.pins.c.product_id == product_id)
