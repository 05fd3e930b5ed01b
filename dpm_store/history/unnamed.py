# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Payloads that no row of the database names.

A process that ends during an insertion leaves such payloads. If they are more than half of all payloads, rows
are missing from the database, and a collection would delete products.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import Connection, func, select

from dpm_store.engine import schema
from dpm_store.engine.database import Database
from dpm_store.payloads.payloads import Payloads

#: Digests compared in one read transaction.
_PAGE = 1000


@dataclass(frozen=True, slots=True)
class UnnamedPayloads:
    """Payloads without a row, and payloads with a row.

    Attributes
    ----------
    files, pack_bytes : int
        Payload files without a row, and bytes of packs without one, in whole blocks.
    named_files, named_pack_bytes : int
        Payload files with a row, and bytes of packs with one. Payloads of deleted products that were
        collected are included.
    """

    files: int
    pack_bytes: int
    named_files: int
    named_pack_bytes: int

    @property
    def is_most(self) -> bool:
        """Return whether most payloads have no row."""
        return self.files > self.named_files or self.pack_bytes > self.named_pack_bytes

    def __str__(self) -> str:
        return f"{self.files} payload files and {self.pack_bytes} bytes of packs have no row"


def unnamed_payloads(database: Database, payloads: Payloads) -> UnnamedPayloads:
    """Compare the payloads on the disk with the rows."""
    files = 0
    for digests in payloads.files.names():
        for start in range(0, len(digests), _PAGE):
            with database.read() as connection:
                files += len(without_row(connection, digests[start : start + _PAGE]))
    p, b = schema.products.c, schema.blobs.c
    in_files = select(func.count()).where(b.location.is_(None), b.size > 0)
    in_packs = select(func.coalesce(func.sum(b.size), 0)).where(b.location.is_not(None))
    with database.read() as connection:
        named_files: int = connection.execute(in_files).scalar_one()
        named_bytes = int(connection.execute(in_packs).scalar_one())
        pack_bytes = max(payloads.packs.allocated_bytes() - named_bytes, 0)
        if files > named_files or pack_bytes > named_bytes:
            collected = select(func.count(), func.coalesce(func.sum(p.size), 0))
            collected = collected.where(p.deleted_ns.is_not(None), p.sha256.is_(None))
            count, size = connection.execute(collected).one()
            named_files, named_bytes = named_files + count, named_bytes + int(size)
    return UnnamedPayloads(files, pack_bytes, named_files, named_bytes)


def without_row(connection: Connection, digests: Sequence[str]) -> list[str]:
    """Return the digests of files that have no row."""
    b = schema.blobs.c
    in_files = select(b.sha256).where(b.sha256.in_(digests), b.location.is_(None))
    stored = set(connection.execute(in_files).scalars())
    return [sha256 for sha256 in digests if sha256 not in stored]
