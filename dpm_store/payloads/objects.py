# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Payloads in an object store, which several processes use: large ones by content, the others in packs.

An object is complete before a row refers to it. A process that ends in between leaves an object without a
row, which ``collect`` removes. The sums of a payload are compared with every object and local copy at
each reading.
"""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator, Sequence
from typing import BinaryIO, cast

from cdff_common.errors import StorageError
from dpm_store.payloads.blobs import BlobFiles, check_chunks, stored_form
from dpm_store.payloads.cache import ObjectCache
from dpm_store.payloads.object_store import ObjectStore
from dpm_store.payloads.packs import PACK_BYTES, Span, location_range, pack_of

_BLOBS, _PACKS = "blobs/", "packs/"
#: Objects up to this size are read completely, and copied; of larger ones only the required range.
_WHOLE_BYTES = 1 << 23


class ObjectFiles(BlobFiles):
    """Payloads that are an object each, by their digest."""

    def __init__(self, store: ObjectStore, cache: ObjectCache) -> None:
        self._store = store
        self._cache = cache
        self._lock = threading.Lock()
        self._damaged: set[str] = set()

    def write(self, sha256: str, payload: bytes, sums: bytes) -> None:
        """Store the payload under its digest; an object that was found damaged is replaced.

        Parameters as for ``BlobFiles.write``.

        Raises
        ------
        StorageError
            If the object store fails.
        """
        content, key = stored_form(payload, sums), _key(sha256)
        is_damaged = sha256 in self._damaged
        if not is_damaged and self._store.size(key) == len(content):
            return
        if is_damaged or not self._store.create(key, content):
            self._store.put(key, content)
        self._cache.remove(sha256)
        self._damaged.discard(sha256)

    def read(self, sha256: str, size: int, sums: bytes, offset: int, length: int, subject: str) -> bytes:
        """Return ``length`` bytes from ``offset`` after comparison with the sums; see ``BlobFiles.read``."""
        for _ in range(2):  # the first time a local copy may be damaged
            is_copy = sha256 in self._cache
            try:
                return self._read_checked(sha256, size, sums, offset, length, subject)
            except StorageError:
                self._cache.remove(sha256)
                if not is_copy:
                    self._damaged.add(sha256)
                    raise
        raise AssertionError("unreachable")

    def names(self) -> Iterator[list[str]]:
        """Yield the SHA-256 digests of the objects, in lists."""
        for page in self._store.list(_BLOBS):
            yield [key.removeprefix(_BLOBS).replace("/", "") for key, _ in page]

    def remove(self, sha256: str) -> int:
        """Delete an object and return its size; raises StorageError."""
        size = self._store.size(_key(sha256))
        self._cache.remove(sha256)
        if size is None:
            return 0
        self._store.remove(_key(sha256))
        return size

    def _open(self, sha256: str, subject: str) -> tuple[BinaryIO, int]:
        copy = self._cache.open(sha256)
        if copy is not None:
            return copy, copy.seek(0, io.SEEK_END)
        key = _key(sha256)
        size = self._store.size(key)
        if size is None:
            raise StorageError(f"{subject}: payload object not readable (it does not exist)")
        if size > _WHOLE_BYTES:
            return cast(BinaryIO, _ObjectReader(self._store, key)), size
        content = self._store.get(key)
        self._cache.add(sha256, content)
        return io.BytesIO(content), len(content)


def _key(sha256: str) -> str:
    return f"{_BLOBS}{sha256[:2]}/{sha256[2:]}"


class _ObjectReader:
    """The parts of a binary file that reading compressed frames uses, on ranges of an object."""

    def __init__(self, store: ObjectStore, key: str) -> None:
        self._store, self._key, self._position = store, key, 0

    def seek(self, position: int) -> int:
        self._position = position
        return position

    def read(self, size: int) -> bytes:
        data = self._store.get_range(self._key, self._position, size)
        self._position += len(data)
        return data

    def close(self) -> None:
        pass


class ObjectPacks:
    """Packs that are an object each, written at once by one transaction."""

    def __init__(self, store: ObjectStore, cache: ObjectCache) -> None:
        self._store = store
        self._cache = cache
        self._newest = 0

    def numbers(self) -> list[int]:
        """Return the numbers of all packs."""
        return [_number(key) for page in self._store.list(_PACKS) for key, _ in page]

    def allocated_bytes(self) -> int:
        """Return the bytes of all packs."""
        return sum(size for page in self._store.list(_PACKS) for _, size in page)

    def append(self, payloads: Sequence[bytes]) -> list[int]:
        """Store payloads and return their locations; durable when this returns.

        Raises
        ------
        StorageError
            If the object store fails.
        """
        locations: list[int] = []
        first = 0
        while first < len(payloads):
            last, offsets, end = first, list[int](), 0
            while last < len(payloads) and (last == first or end < PACK_BYTES):
                offsets.append(end)
                end += len(payloads[last])
                last += 1
            start = location_range(self._create(b"".join(payloads[first:last])))[0]
            locations += [start + offset for offset in offsets]
            first = last
        return locations

    def _create(self, content: bytes) -> int:
        """Create the pack with the next number, which no process has used."""
        while not self._store.create(_pack_key(self._newest + 1), content):
            after = _pack_key(self._newest)
            self._newest = max(
                (_number(key) for page in self._store.list(_PACKS, after) for key, _ in page),
                default=self._newest + 1,
            )
        self._newest += 1
        return self._newest

    def flush(self) -> None:
        """Do nothing: objects are durable once they are stored."""

    def read(self, span: Span, sums: bytes, subject: str) -> bytes:
        """Return a payload after comparison with its sums.

        Raises
        ------
        StorageError
            If the pack is missing or short, or the payload does not match the sums.
        """
        location, size = span
        name = f"{location}-{size}"
        copy = self._cache.open(name)
        if copy is not None:
            with copy:
                data = copy.read()
            try:
                if len(data) == size:
                    check_chunks(data, 0, sums, subject)
                    return data
            except StorageError:
                self._cache.remove(name)
        number = pack_of(location)
        start = location - location_range(number)[0]
        data = self._store.get_range(_pack_key(number), start, size)
        if len(data) != size:
            raise StorageError(
                f"{subject}: its pack ends at byte {start + len(data)}, expected {start + size}"
            )
        check_chunks(data, 0, sums, subject)
        self._cache.add(name, data)
        return data

    def reclaim(self, number: int, live: Sequence[Span]) -> bool:
        """Remove a pack without live spans; objects have no holes. Raises StorageError."""
        if not live:
            self._store.remove(_pack_key(number))
        return True

    def close(self) -> None:
        """Do nothing: no file is open."""


def _pack_key(number: int) -> str:
    return f"{_PACKS}{number:010d}"


def _number(key: str) -> int:
    return int(key.removeprefix(_PACKS))
