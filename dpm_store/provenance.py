# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a product was made from, and what was made from it, through all generations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from sqlalchemy import Connection, select

from cdff_common.errors import InputError, ProductNotFoundError
from dpm_store import schema
from dpm_store.database import Database
from dpm_store.products import record_of
from dpm_store.records import ProductRecord

MAX_GENERATIONS = 64
MAX_NODES = 10_000
#: Ids in one statement: engines bound the number of values.
_BATCH = 500


class Direction(StrEnum):
    """Which way to follow."""

    UP = "up"
    DOWN = "down"


@dataclass(frozen=True, slots=True)
class Lineage:
    """Products that a product comes from (up) or that come from it (down).

    Attributes
    ----------
    product_id : str
    direction : Direction
    generations : tuple of tuple of str
        Ids by the least number of steps to them; the first is one step away. Each id once.
    links : tuple of (str, str)
        Product and the input it was made from, for every step that was followed.
    records : mapping of str to ProductRecord
        Of those that the store holds or held; an input that is missing here was never a product of this store, as a
        sensor's sample.
    truncated : bool
        There is more than ``MAX_NODES`` or ``MAX_GENERATIONS``.
    """

    product_id: str
    direction: Direction
    generations: tuple[tuple[str, ...], ...]
    links: tuple[tuple[str, str], ...]
    records: dict[str, ProductRecord]
    truncated: bool = False


def lineage(database: Database, product_id: str, direction: str = "up", depth: int = MAX_GENERATIONS) -> Lineage:
    """Follow the inputs of a product, or what was made from it; deleted products are followed too.

    Raises
    ------
    ProductNotFoundError
        If the store never held the product.
    InputError
        On another direction, or a depth out of 1 to ``MAX_GENERATIONS``.
    """
    if direction not in list(Direction) or not 1 <= depth <= MAX_GENERATIONS:
        raise InputError(f"provenance {direction[:20]!r}, depth {depth}: expected up or down, 1 to {MAX_GENERATIONS}")
    way = Direction(direction)
    p = schema.products.c
    with database.read() as connection:
        if connection.execute(select(p.id).where(p.id == product_id)).first() is None:
            raise ProductNotFoundError(f"no product {product_id[:64]!r}")
        seen, links = {product_id}, []
        generations: list[tuple[str, ...]] = []
        front: tuple[str, ...] = (product_id,)
        while front and len(generations) < depth and len(seen) <= MAX_NODES:
            steps = _steps(connection, front, way)
            links += steps
            reached = (used if way is Direction.UP else made for made, used in steps)
            front = tuple(i for i in dict.fromkeys(reached) if i not in seen)
            seen.update(front)
            if front:
                generations.append(front)
        more = bool(front) and bool(_steps(connection, front, way))
        records = _records(connection, [i for generation in generations for i in generation])
    return Lineage(product_id, way, tuple(generations), tuple(links), records, more)


def _steps(connection: Connection, ids: Sequence[str], way: Direction) -> list[tuple[str, str]]:
    v = schema.provenance.c
    end = v.product_id if way is Direction.UP else v.input_id
    found: list[tuple[str, str]] = []
    for i in range(0, len(ids), _BATCH):
        part = select(v.product_id, v.input_id).where(end.in_(ids[i : i + _BATCH])).order_by(v.product_id, v.input_id)
        found += [(made, used) for made, used in connection.execute(part)]
    return found


def _records(connection: Connection, ids: Sequence[str]) -> dict[str, ProductRecord]:
    records: dict[str, ProductRecord] = {}
    for i in range(0, len(ids), _BATCH):
        part = select(schema.products).where(schema.products.c.id.in_(ids[i : i + _BATCH]))
        records |= {row.id: record_of(row) for row in connection.execute(part)}
    return records
