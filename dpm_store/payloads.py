# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Payloads by their content: large ones in a file each, the others in packs; each content once."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import Connection

from cdff_common.errors import StorageError
from dpm_store import sqlite
from dpm_store.blobs import BlobFiles
from dpm_store.database import Database
from dpm_store.packs import PackFiles, pack_of, places_of

#: Larger payloads have a file each.
PACKED_BYTES = 1 << 15
BLOBS, PACKS = "blobs", "packs"


class Content(NamedTuple):
    """A payload, and the sums of its chunks."""

    payload: bytes
    sums: bytes


class Payloads:
    """Where payloads lie, below the directory of a store.

    Attributes
    ----------
    files : BlobFiles
    packs : PackFiles
    """

    def __init__(self, directory: Path) -> None:
        self.files = BlobFiles(directory / BLOBS)
        self.packs = PackFiles(directory / PACKS)
        self._untidy = set(self.packs.numbers())  # a crash may have left something

    def enter(self, connection: Connection, contents: Mapping[str, Content], products: Mapping[str, int]) -> None:
        """Write payloads, durable once ``settle`` returns, and their rows, inside a transaction; by digest.

        Parameters
        ----------
        connection : Connection
        contents : mapping of str to Content
        products : mapping of str to int
            How many products that are entered have each.

        Those there already are kept where they are as they were.

        Raises
        ------
        StorageError
            If the disk is full or fails.
        """
        there = sqlite.placed(connection, list(contents))
        packed: dict[str, bytes] = {}
        for sha256, content in contents.items():
            if len(content.payload) > PACKED_BYTES:
                self.files.write(sha256, content.payload)  # again only if a collection took it since
            elif sha256 not in there or not self._holds(there[sha256], content):
                packed[sha256] = content.payload
                if sha256 in there:
                    self.lost(there[sha256])
        places = dict(zip(packed, self.packs.append(list(packed.values())), strict=True)) if packed else {}
        rows = [
            {
                "sha256": sha256, "size": len(payload), "chunk_sums": sums, "place": places.get(sha256),
                "live": products[sha256],
            }
            for sha256, (payload, sums) in contents.items()
        ]  # fmt: skip
        sqlite.insert_blobs(connection, rows)
        new = [(sha256 in places, len(content.payload)) for sha256, content in contents.items() if sha256 not in there]
        sqlite.count_blobs(connection, new)

    def settle(self) -> None:
        """Wait until the disk has what was entered; raises StorageError where it fails. Then rows may be committed."""
        self.packs.settle()

    def read(self, row: Any, offset: int, length: int, what: str) -> bytes:
        """Bytes of a payload, checked, from its row of ``blobs``; raises StorageError where they are not as written."""
        if length == 0:
            return b""
        if row.place is None:
            return self.files.read(row.sha256, row.size, row.chunk_sums, offset, length, what)
        payload = self.packs.read((row.place, row.size), row.chunk_sums, what)
        return payload if length == row.size else payload[offset : offset + length]

    def lost(self, place: int | None) -> None:
        """Keep in mind that a row no longer names this place."""
        if place is not None:
            self._untidy.add(pack_of(place))

    def reclaim(self, database: Database) -> None:
        """Give the disk back what no row names any more in packs; what is being copied is left for the next time."""
        for number in sorted(self._untidy):
            with database.freeing() as connection:  # nobody adds meanwhile
                if self.packs.reclaim(number, sqlite.spans(connection, *places_of(number))):
                    self._untidy.discard(number)

    def _holds(self, place: int | None, content: Content) -> bool:
        if place is None:
            return True
        try:
            return self.packs.read((place, len(content.payload)), content.sums, "payload") == content.payload
        except StorageError:
            return False

    def close(self) -> None:
        """Close what is open."""
        self.packs.close()
