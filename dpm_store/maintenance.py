# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Looking after the store: is everything as it was written, what takes the room, what can go.

All of it goes through the store in steps, so that it neither holds much in memory nor keeps writers waiting.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import msgpack
from sqlalchemy import Connection, bindparam, func, select, update

from cdff_common.errors import InputError, StorageError
from cdff_common.interfaces.product import Header
from dpm_store import schema, sqlite
from dpm_store.blobs import digest
from dpm_store.database import Database
from dpm_store.payloads import Payloads

#: Rows looked at in one read, and payloads removed in one write.
_READ, _WRITE = 1000, 200


@dataclass(frozen=True, slots=True)
class Problem:
    """Something that is not as it was written: where, and what."""

    where: str
    what: str


@dataclass(frozen=True, slots=True)
class Statistics:
    """What is in the store.

    Attributes
    ----------
    products : mapping of (robot, product) to int
        Live products.
    product_bytes : mapping of (robot, product) to int
        Of their payloads, each product's counted.
    newest_t1_ns : int or None
        Newest end of capture.
    events : int
    payloads, stored_bytes : int
        Payloads that are kept, each content once.
    free_bytes : int
        That the disk has left.
    """

    products: Mapping[tuple[str, str], int]
    product_bytes: Mapping[tuple[str, str], int]
    newest_t1_ns: int | None
    events: int
    payloads: int
    stored_bytes: int
    free_bytes: int

    @property
    def count(self) -> int:
        """Live products in all."""
        return sum(self.products.values())

    @property
    def payload_bytes(self) -> int:
        """Bytes of the payloads of live products, each product's counted."""
        return sum(self.product_bytes.values())


def verify(database: Database, payloads: Payloads) -> tuple[Problem, ...]:
    """Check the database, the index, the headers, the sums that are kept, and the SHA-256 of every payload."""
    with database.read() as connection:
        problems = [Problem("database", what) for what in sqlite.check(connection)]
    problems += _headers(database)
    for sha256 in _digests(database):
        where = f"payload {sha256}"
        try:
            with database.read() as connection:
                row = connection.execute(select(schema.blobs).where(schema.blobs.c.sha256 == sha256)).first()
            if row is None:
                continue
            if digest(payloads.read(row, 0, row.size, where)) != sha256:
                problems.append(Problem(where, "content has another digest"))
        except StorageError as error:
            problems.append(Problem(where, str(error)))
    return tuple(problems)


def _headers(database: Database) -> Iterator[Problem]:
    """Products whose header cannot be read or says something else than their row."""
    p, last = schema.products.c, -1
    page = select(p.ordinal, p.id, p.header, p.sha256, p.deleted_ns, p.t1_ns, p.frame).order_by(p.ordinal).limit(_READ)
    while True:
        with database.read() as connection:
            rows = connection.execute(page.where(p.ordinal > last)).all()
        if not rows:
            return
        last = rows[-1].ordinal
        for row in rows:
            try:
                header = Header.from_dict(msgpack.unpackb(row.header))
            except (ValueError, InputError) as error:
                yield Problem(f"product {row.id}", f"header not readable: {error}")
                continue
            if (header.id, header.t1_ns, header.frame) != (row.id, row.t1_ns, row.frame) or (
                row.sha256 != header.sha256 and (row.deleted_ns is None or row.sha256 is not None)
            ):
                yield Problem(f"product {row.id}", "its row and its header differ")


def _digests(database: Database) -> Iterator[str]:
    b, last = schema.blobs.c, ""
    page = select(b.sha256).order_by(b.sha256).limit(_READ)
    while True:
        with database.read() as connection:
            found = connection.execute(page.where(b.sha256 > last)).scalars().all()
        if not found:
            return
        last = found[-1]
        yield from found


def collect(database: Database, payloads: Payloads) -> int:
    """Remove payloads that only tombstones name, and files that no row names; returns the bytes freed.

    Safe beside writers: what seemed unused is looked at again in the transaction that removes it, and a product that
    is inserted meanwhile with the same content writes its payload anew.
    """
    freed = 0
    for digests in _of_tombstones(database):
        freed += _forget(database, payloads, digests)
    payloads.reclaim(database)
    for found in payloads.files.names():
        for start in range(0, len(found), _WRITE):
            with database.read() as connection:
                unnamed = _unnamed(connection, found[start : start + _WRITE])
            if unnamed:
                with database.freeing() as connection:
                    freed += sum(payloads.files.remove(sha256) for sha256 in _unnamed(connection, unnamed))
    return freed


def _of_tombstones(database: Database) -> Iterator[Sequence[str]]:
    """Payloads that tombstones still name, some at a time."""
    p, last = schema.products.c, ""
    page = (
        select(p.sha256).where(p.deleted_ns.is_not(None), p.sha256.is_not(None)).distinct().order_by(p.sha256)
        .limit(_WRITE)
    )  # fmt: skip
    while True:
        with database.read() as connection:
            found = connection.execute(page.where(p.sha256 > last)).scalars().all()
        if not found:
            return
        last = str(found[-1])
        yield [str(sha256) for sha256 in found]


def _forget(database: Database, payloads: Payloads, digests: Sequence[str]) -> int:
    """Take the rows of payloads without a live product out; bytes of those in packs."""
    p, b = schema.products.c, schema.blobs.c
    unused = select(b.sha256, b.size, b.place).where(b.sha256.in_(digests), b.live == 0)
    unname = update(schema.products).values(sha256=None)
    unname = unname.where(p.sha256 == bindparam("gone"), p.sha256.is_not(None), p.deleted_ns.is_not(None))
    with database.freeing() as connection:
        rows = connection.execute(unused).all()
        if rows:
            connection.execute(unname, [{"gone": sha256} for sha256, _, _ in rows])
            connection.execute(
                schema.blobs.delete().where(b.sha256 == bindparam("gone")), [{"gone": r[0]} for r in rows]
            )
    for _, _, place in rows:
        payloads.lost(place)
    return sum(int(size) for _, size, place in rows if place is not None)


def _unnamed(connection: Connection, digests: Sequence[str]) -> list[str]:
    b = schema.blobs.c
    named = set(connection.execute(select(b.sha256).where(b.sha256.in_(digests), b.place.is_(None))).scalars())
    return [sha256 for sha256 in digests if sha256 not in named]


def statistics(database: Database) -> Statistics:
    """Counts and sizes, from sums that the database keeps with every change."""
    p, t, b, e = schema.products.c, schema.tallies.c, schema.blob_tallies.c, schema.events.c
    newest = select(p.t1_ns).where(p.deleted_ns.is_(None)).order_by(p.t1_ns.desc()).limit(1)
    with database.read() as connection:
        counts = connection.execute(select(t.robot, t.product, t.live, t.bytes).where(t.live > 0)).all()
        payloads, stored = connection.execute(
            select(func.coalesce(func.sum(b.payloads), 0), func.coalesce(func.sum(b.bytes), 0))
        ).one()
        newest_ns = connection.execute(newest).scalar()
        events = connection.execute(select(func.max(e.ordinal))).scalar() or 0
    return Statistics(
        {(r.robot, r.product): r.live for r in counts}, {(r.robot, r.product): r.bytes for r in counts}, newest_ns,
        int(events), int(payloads), int(stored), database.room.free_bytes(),
    )  # fmt: skip
