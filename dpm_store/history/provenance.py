# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Inputs and derived products of a product, through all generations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import Connection, select

from cdff_common.contract.limits import MAX_GENERATIONS
from cdff_common.errors import InputError
from dpm_store.engine import schema
from dpm_store.engine.database import Database, dialect_of
from dpm_store.products.products import record_of, row_of
from dpm_store.products.records import ProductRecord

MAX_NODES = 10_000


@dataclass(frozen=True, slots=True)
class Lineage:
    """Inputs (up) of a product, or products derived from it (down).

    Attributes
    ----------
    product_id : str
    direction : str
        ``up`` (to the inputs) or ``down`` (to the derived products).
    generations : tuple of tuple of str
        Ids grouped by the smallest number of steps, from one step; each id once.
    links : tuple of (str, str)
        Product and input of every step.
    records : mapping of str to ProductRecord
        Live and deleted products by id; inputs that were never stored, such as sensor samples, are missing.
    truncated : bool
        More products exist than ``MAX_NODES`` or ``MAX_GENERATIONS``.
    """

    product_id: str
    direction: str
    generations: tuple[tuple[str, ...], ...]
    links: tuple[tuple[str, str], ...]
    records: dict[str, ProductRecord]
    truncated: bool = False


def lineage(
    database: Database, product_id: str, direction: str = "up", depth: int = MAX_GENERATIONS
) -> Lineage:
    """Return the inputs of a product, or the products derived from it; deleted products are included.

    Raises
    ------
    ProductNotFoundError
        If the product was never stored.
    InputError
        If the direction is unknown, or the depth outside 1 to ``MAX_GENERATIONS``.
    """
    if direction not in ("up", "down") or not 1 <= depth <= MAX_GENERATIONS:
        raise InputError(
            f"provenance {direction[:20]!r}, depth {depth}: expected up or down, 1 to {MAX_GENERATIONS}"
        )
    with database.read() as connection:
        row_of(connection, product_id)
        visited, links = {product_id}, []
        generations: list[tuple[str, ...]] = []
        frontier: tuple[str, ...] = (product_id,)
        while frontier and len(generations) < depth and len(visited) <= MAX_NODES:
            steps = _steps(connection, frontier, direction)
            links += steps
            neighbours = (used_id if direction == "up" else derived_id for derived_id, used_id in steps)
            frontier = tuple(i for i in dict.fromkeys(neighbours) if i not in visited)
            visited.update(frontier)
            if frontier:
                generations.append(frontier)
        is_truncated = bool(frontier) and bool(_steps(connection, frontier, direction))
        records = _records(connection, [i for generation in generations for i in generation])
    return Lineage(product_id, direction, tuple(generations), tuple(links), records, is_truncated)


def _steps(connection: Connection, ids: Sequence[str], direction: str) -> list[tuple[str, str]]:
    """Return the pairs (product, input) one step up or down from products."""
    v, dialect = schema.provenance.c, dialect_of(connection)
    end = v.product_id if direction == "up" else v.input_id
    steps = select(v.product_id, v.input_id).where(end.in_(dialect.elements("ids")))
    pairs = connection.execute(steps.order_by(v.product_id, v.input_id), {"ids": dialect.list_value(ids)})
    return [(derived_id, used_id) for derived_id, used_id in pairs]


def _records(connection: Connection, ids: Sequence[str]) -> dict[str, ProductRecord]:
    dialect = dialect_of(connection)
    rows = select(schema.products).where(schema.products.c.id.in_(dialect.elements("ids")))
    record_rows = connection.execute(rows, {"ids": dialect.list_value(ids)})
    return {row.id: record_of(row) for row in record_rows}
