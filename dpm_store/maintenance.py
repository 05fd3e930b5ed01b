# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Looking after the store: is everything as it was written, what takes the room, what can go."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sqlalchemy import exists, func, select, update

from cdff_common.errors import StorageError
from dpm_store import schema, sqlite
from dpm_store.blobs import BlobFiles, digest
from dpm_store.database import Database


@dataclass(frozen=True, slots=True)
class Problem:
    """Something that is not as it was written: where, and what."""

    where: str
    what: str


@dataclass(frozen=True, slots=True)
class Statistics:
    """Counts of live products by (robot, type), bytes of their payloads, newest end of capture."""

    products: Mapping[tuple[str, str], int]
    payload_bytes: int
    newest_t1_ns: int | None
    events: int

    @property
    def count(self) -> int:
        """Live products in all."""
        return sum(self.products.values())


def verify(database: Database, files: BlobFiles) -> tuple[Problem, ...]:
    """Check the database, the index, and the SHA-256 of every payload."""
    with database.read() as connection:
        problems = [Problem("database", what) for what in sqlite.check(connection)]
        blobs = connection.execute(select(schema.blobs.c.sha256, schema.blobs.c.size)).all()
    for sha256, size in blobs:
        try:
            with database.read() as connection:
                row = connection.execute(select(schema.blobs).where(schema.blobs.c.sha256 == sha256)).first()
            if row is None:
                continue
            payload = row.content
            if payload is None:
                payload = files.read(sha256, size, row.chunk_sums, 0, size, f"payload {sha256}") if size else b""
            if digest(payload) != sha256:
                problems.append(Problem(f"payload {sha256}", "content has another digest"))
        except StorageError as error:
            problems.append(Problem(f"payload {sha256}", str(error)))
    return tuple(problems)


def collect(database: Database, files: BlobFiles) -> int:
    """Remove payloads that only tombstones name, and files that no row names; returns the bytes freed."""
    p, b = schema.products.c, schema.blobs.c
    with database.write() as connection:
        used = exists().where(p.sha256 == b.sha256, p.deleted_ns.is_(None))
        gone = connection.execute(select(b.sha256, b.size, b.content.is_not(None)).where(~used)).all()
        for sha256, _, _ in gone:
            connection.execute(update(schema.products).where(p.sha256 == sha256).values(sha256=None))
            connection.execute(schema.blobs.delete().where(b.sha256 == sha256))
        freed = sum(int(size) for _, size, inline in gone if inline)
    # The rows are gone for good before a file is; a put meanwhile waits for the next lock and writes its file anew.
    with database.write() as connection:
        named = set(connection.execute(select(b.sha256).where(b.content.is_(None))).scalars())
        freed += sum(files.remove(sha256) for sha256 in list(files.names()) if sha256 not in named)
    return freed


def statistics(database: Database) -> Statistics:
    """Counts and sizes of live products."""
    p = schema.products.c
    alive = p.deleted_ns.is_(None)
    with database.read() as connection:
        counts = connection.execute(
            select(p.robot, p.product, func.count()).where(alive).group_by(p.robot, p.product)
        ).all()
        size, newest = connection.execute(
            select(func.coalesce(func.sum(p.size), 0), func.max(p.t1_ns)).where(alive)
        ).one()
        events = connection.execute(select(func.count()).select_from(schema.events)).scalar_one()
    return Statistics({(r, t): n for r, t, n in counts}, int(size), newest, int(events))
