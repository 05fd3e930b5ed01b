# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Payloads by their content, each stored once: large ones in a file each, the others in packs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from sqlalchemy import Connection, bindparam, select

from cdff_common.errors import StorageError
from dpm_store.engine import schema
from dpm_store.engine.database import EMBEDDED, Database, add_to_tallies, dialect_of
from dpm_store.engine.dialect import Dialect
from dpm_store.payloads.blobs import BlobFiles
from dpm_store.payloads.packs import PackFiles, location_range, pack_of

if TYPE_CHECKING:
    from dpm_store.payloads.objects import ObjectPacks

#: Larger payloads have a file each.
PACKED_BYTES = 1 << 15
BLOBS, PACKS, CACHE = "blobs", "packs", "cache"
#: Quota of the local copies of objects.
CACHE_BYTES = 1 << 30

_b = schema.blobs.c
_SPANS = (
    select(_b.location, _b.size)
    .where(_b.location >= bindparam("first"), _b.location < bindparam("end"))
    .order_by(_b.location)
)


def has_payloads(directory: Path) -> bool:
    """Return whether the directory of a store has payloads."""
    files = chain((directory / PACKS).glob("*.pack"), (directory / BLOBS).glob("??/*"))
    return any(path.stat().st_size for path in files)


class Content(NamedTuple):
    """A payload and the sums of its chunks."""

    payload: bytes
    sums: bytes


class Payloads:
    """The payloads of a store, in its directory or in an object store.

    Parameters
    ----------
    url : str
        URL of the object store; empty for the directory.
    cache_bytes : int
        Quota of the local copies of objects.
    is_read_only : bool
        Another process writes to the directory: nothing is removed from it.

    Attributes
    ----------
    damaged : dict of str to str
        Digests of payloads that could not be read, with the reason, until they are repaired or removed.
    """

    def __init__(
        self,
        directory: Path,
        dialect: Dialect = EMBEDDED,
        url: str = "",
        cache_bytes: int = CACHE_BYTES,
        *,
        is_read_only: bool = False,
    ) -> None:
        self.damaged: dict[str, str] = {}
        self.files: BlobFiles
        self.packs: PackFiles | ObjectPacks
        self._reclaimable: set[int] = set()
        if url:
            from dpm_store.payloads.cache import ObjectCache
            from dpm_store.payloads.object_store import ObjectStore
            from dpm_store.payloads.objects import ObjectFiles, ObjectPacks

            objects, cache = ObjectStore(url), ObjectCache(directory / CACHE, cache_bytes)
            self.files, self.packs = ObjectFiles(objects, cache), ObjectPacks(objects, cache)
        else:
            self.files = BlobFiles(directory / BLOBS, removes_parts=not is_read_only)
            self.packs = PackFiles(directory / PACKS)
            self._reclaimable = set(self.packs.numbers())  # a crash may have left unreferenced ranges
        digests = dialect.elements("digests")
        self._locations = select(_b.sha256, _b.location).where(_b.sha256.in_(digests))

    def insert(
        self, connection: Connection, contents: Mapping[str, Content], products: Mapping[str, int]
    ) -> None:
        """Write payloads, durable after ``packs.flush``, and their rows, inside a transaction.

        Parameters
        ----------
        connection : Connection
        contents : mapping of str to Content
            Contents by digest. A payload that is stored and intact is not written again.
        products : mapping of str to int
            Number of new products with each payload, by digest.

        Raises
        ------
        StorageError
            If the disk is full or fails.
        """
        dialect = dialect_of(connection)
        parameters = {"digests": dialect.list_value(list(contents))}
        stored: dict[str, int | None] = dict(dialect.fetch(connection, self._locations, parameters))
        packed: dict[str, bytes] = {}
        for sha256, content in contents.items():
            if len(content.payload) > PACKED_BYTES:
                self.files.write(sha256, *content)  # again only if it was removed or is damaged
            elif sha256 not in stored or not self._is_intact(stored[sha256], content):
                packed[sha256] = content.payload
                if sha256 in stored:
                    self.mark_unreferenced(stored[sha256])
        self.set_intact(contents)
        locations = dict(zip(packed, self.packs.append(list(packed.values())), strict=True)) if packed else {}
        rows = [
            {
                "sha256": sha256,
                "size": len(payload),
                "chunk_sums": sums,
                "location": locations.get(sha256),
                "live": products[sha256],
            }
            for sha256, (payload, sums) in contents.items()
        ]
        dialect.upsert_rows(connection, schema.blobs, rows, add=("live",), replace=("location",))
        new_sizes = [
            ((sha256 in locations,), len(content.payload))
            for sha256, content in contents.items()
            if sha256 not in stored
        ]
        add_to_tallies(connection, schema.blob_tallies, new_sizes)

    def read(self, row: Any, offset: int, length: int, subject: str) -> bytes:
        """Return checked bytes of a payload from its row of ``blobs``; raises StorageError if corrupt."""
        if length == 0:
            return b""
        try:
            if row.location is None:
                return self.files.read(row.sha256, row.size, row.chunk_sums, offset, length, subject)
            payload = self.packs.read((row.location, row.size), row.chunk_sums, subject)
        except StorageError as error:
            self.damaged[row.sha256] = str(error)
            raise
        return payload if length == row.size else payload[offset : offset + length]

    def set_intact(self, digests: Iterable[str]) -> None:
        """Record that payloads were repaired or removed."""
        for sha256 in digests:
            self.damaged.pop(sha256, None)

    def mark_unreferenced(self, location: int | None) -> None:
        """Record that no row references a location any more."""
        if location is not None:
            self._reclaimable.add(pack_of(location))

    def mark_packs(self) -> None:
        """Record that any pack may have unreferenced ranges, which another process left."""
        self._reclaimable.update(self.packs.numbers())

    def reclaim(self, database: Database) -> None:
        """Free the unreferenced ranges of packs; packs being copied are skipped until the next call."""
        for number in sorted(self._reclaimable):
            first, end = location_range(number)
            with database.deletion() as connection:  # no process appends meanwhile
                live = database.dialect.fetch(connection, _SPANS, {"first": first, "end": end})
                if self.packs.reclaim(number, live):
                    self._reclaimable.discard(number)

    def _is_intact(self, location: int | None, content: Content) -> bool:
        """Return whether the stored payload equals the content; True for a payload in a file of its own."""
        if location is None:
            return True
        span = (location, len(content.payload))
        try:
            return self.packs.read(span, content.sums, "payload") == content.payload
        except StorageError:
            return False
