# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maintenance of a store: verification, statistics, and collection of unused payloads.

All functions work in steps, so that they need little memory and do not block writers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgpack
from sqlalchemy import Row, Select, bindparam, func, select, update

from cdff_common.errors import InputError, StorageError
from cdff_common.interfaces.product import Header
from dpm_store.changes.change_recorder import ChangeRecorder, ServerChanges
from dpm_store.engine import schema
from dpm_store.engine.database import Database
from dpm_store.history.unnamed import without_row
from dpm_store.payloads.blobs import digest
from dpm_store.payloads.payloads import Payloads

#: Rows in one read transaction, and payloads in one write transaction.
_READ_ROWS, _WRITE_PAYLOADS = 1000, 200


@dataclass(frozen=True, slots=True)
class Problem:
    """A defect: its location and description."""

    where: str
    what: str


@dataclass(frozen=True, slots=True)
class Statistics:
    """Counts and sizes of the contents of a store.

    Attributes
    ----------
    products : mapping of (robot, product) to int
        Live products.
    product_bytes : mapping of (robot, product) to int
        Bytes of their payloads; a shared payload counts for each product.
    newest_t1_ns : int or None
        Newest end of capture.
    events : int
    payloads, stored_bytes : int
        Number and bytes of stored payloads, each content once, before compression.
    free_bytes : int
        Free space of the disk.
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
        """Number of live products."""
        return sum(self.products.values())

    @property
    def payload_bytes(self) -> int:
        """Bytes of the payloads of live products; a shared payload counts for each product."""
        return sum(self.product_bytes.values())


def verify(
    database: Database, payloads: Payloads, changes: ChangeRecorder | ServerChanges
) -> tuple[Problem, ...]:
    """Check the database, the index, the sums, the headers, and the SHA-256 of every payload.

    A database that is known to be damaged or replaced is a problem; see ``ChangeRecorder``.
    """
    with database.read() as connection:
        problems = [Problem("database", what) for what in database.dialect.check(connection)]
        problems += [
            Problem("database", f"{name}: {count} differ from the rows that they count")
            for name, differing in _differing_sums().items()
            if (count := connection.execute(differing).scalar_one())
        ]
    problems += _header_problems(database)
    problems += [Problem("database", changes.loss)] if changes.loss else []
    for rows in _pages(database, select(schema.blobs.c.sha256), _READ_ROWS):
        problems += [problem for row in rows for problem in _payload_problems(database, payloads, row.sha256)]
    return tuple(problems)


def _payload_problems(database: Database, payloads: Payloads, sha256: str) -> Iterator[Problem]:
    """Yield the defect of a payload; nothing if the payload was removed after the check began."""
    where = f"payload {sha256}"
    try:
        with database.read() as connection:
            row = connection.execute(select(schema.blobs).where(schema.blobs.c.sha256 == sha256)).first()
        if row is not None and digest(payloads.read(row, 0, row.size, where)) != sha256:
            yield Problem(where, "content has another digest")
    except StorageError as error:
        yield Problem(where, str(error))


def _differing_sums() -> dict[str, Select[Any]]:
    """Return counts of the stored sums that differ from the rows, by name."""
    p, t, b, bt = schema.products.c, schema.tallies.c, schema.blobs.c, schema.blob_tallies.c
    is_live, count, is_packed = p.deleted_ns.is_(None), func.count(), b.location.is_not(None)
    sums = {
        "sums": (
            select(t.robot, t.product, t.live, t.bytes).where(t.live != 0),
            select(p.robot, p.product, count, func.sum(p.size)).where(is_live).group_by(p.robot, p.product),
        ),
        "payloads": (
            select(b.sha256, b.live).where(b.live != 0),
            select(p.sha256, count).where(is_live).group_by(p.sha256),
        ),
        "sums of payloads": (
            select(bt.packed, bt.live, bt.bytes).where(bt.live != 0),
            select(is_packed, count, func.sum(b.size)).group_by(is_packed),
        ),
    }
    return {
        name: select(func.count()).select_from(stored.except_(actual).subquery())
        for name, (stored, actual) in sums.items()
    }


def _pages(database: Database, statement: Select[Any], limit: int) -> Iterator[Sequence[Row[Any]]]:
    """Return rows in the order of their first column, in pages with a transaction each."""
    (key,) = list(statement.selected_columns)[:1]
    page = statement.order_by(key).limit(limit)
    while True:
        with database.read() as connection:
            rows = connection.execute(page).all()
        if not rows:
            return
        yield rows
        page = statement.where(key > rows[-1][0]).order_by(key).limit(limit)


def _header_problems(database: Database) -> Iterator[Problem]:
    """Yield the products with an unreadable header, or a header that differs from the row."""
    p = schema.products.c
    columns = select(p.ordinal, p.id, p.header, p.sha256, p.deleted_ns, p.t1_ns, p.frame)
    for rows in _pages(database, columns, _READ_ROWS):
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


def collect(database: Database, payloads: Payloads, changes: ChangeRecorder | ServerChanges) -> int:
    """Remove payloads of tombstones only, and payloads without a row; return the bytes freed.

    Safe with concurrent writers: a payload is checked again in the transaction that removes it, and a product
    that is inserted meanwhile with the same content writes its payload again.

    Raises
    ------
    StorageError
        If the database is known to be damaged or replaced: nothing is removed.
    """
    if changes.loss:
        raise StorageError(f"nothing is collected: {changes.loss}")
    freed_bytes = 0
    p = schema.products.c
    of_tombstones = select(p.sha256).where(p.deleted_ns.is_not(None), p.sha256.is_not(None)).distinct()
    for rows in _pages(database, of_tombstones, _WRITE_PAYLOADS):
        freed_bytes += _delete_unused(database, payloads, [row.sha256 for row in rows])
    if database.dialect.is_shared:
        payloads.mark_packs()
    payloads.reclaim(database)
    for digests in payloads.files.names():
        for start in range(0, len(digests), _WRITE_PAYLOADS):
            with database.read() as connection:
                orphans = without_row(connection, digests[start : start + _WRITE_PAYLOADS])
            if orphans:
                with database.deletion() as connection:
                    orphans = without_row(connection, orphans)
                    freed_bytes += sum(payloads.files.remove(sha256) for sha256 in orphans)
    return freed_bytes


def _delete_unused(database: Database, payloads: Payloads, digests: Sequence[str]) -> int:
    """Delete the rows of payloads without a live product; return the bytes of those in packs."""
    p, b = schema.products.c, schema.blobs.c
    unused = select(b.sha256, b.size, b.location).where(b.sha256.in_(digests), b.live == 0)
    clear = update(schema.products).values(sha256=None)
    clear = clear.where(p.sha256 == bindparam("unused"), p.sha256.is_not(None), p.deleted_ns.is_not(None))
    with database.deletion() as connection:
        rows = connection.execute(unused).all()
        if rows:
            values = [{"unused": row.sha256} for row in rows]
            connection.execute(clear, values)
            connection.execute(schema.blobs.delete().where(b.sha256 == bindparam("unused")), values)
    for row in rows:
        payloads.mark_unreferenced(row.location)
    payloads.set_intact(row.sha256 for row in rows)
    return sum(int(row.size) for row in rows if row.location is not None)


def statistics(database: Database) -> Statistics:
    """Return counts and sizes, from sums that are updated with every change."""
    p, t, b, e = schema.products.c, schema.tallies.c, schema.blob_tallies.c, schema.events.c
    newest = select(p.t1_ns).where(p.deleted_ns.is_(None)).order_by(p.t1_ns.desc()).limit(1)
    with database.read() as connection:
        counts = connection.execute(select(t.robot, t.product, t.live, t.bytes).where(t.live > 0)).all()
        payloads, stored = connection.execute(
            select(func.coalesce(func.sum(b.live), 0), func.coalesce(func.sum(b.bytes), 0))
        ).one()
        newest_ns = connection.execute(newest).scalar()
        events = connection.execute(select(func.max(e.ordinal))).scalar() or 0
    return Statistics(
        {(r.robot, r.product): r.live for r in counts},
        {(r.robot, r.product): r.bytes for r in counts},
        newest_ns,
        int(events),
        int(payloads),
        int(stored),
        database.disk_space.free_bytes(),
    )
