# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of products that the DPM has not acknowledged; they survive the end of the process."""

from __future__ import annotations

import logging
import os
import struct
from collections import deque
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from zlib import crc32

from cdff_common.bus.message import pack, unpack
from cdff_common.clock import wall_ns
from cdff_common.errors import CodecError, ConfigurationError
from cdff_common.output import replace_file
from cdff_common.process import data_dir_of

logger = logging.getLogger(__name__)

#: Default of ``CDFF_OUTBOX_MB``, megabytes.
DEFAULT_MB = 256
_SUFFIX = ".product"
_PART = ".part"
#: Length of the header; CRC-32 of header and payload.
_PREFIX = struct.Struct("<II")
#: Smallest size of an entry, bytes: one disk block, more than its memory use without payload.
_MIN_BYTES = 4096


@dataclass(frozen=True, slots=True)
class SpooledProduct:
    """An encoded product."""

    robot: str
    dfpc: str
    port: str
    product: str
    payload: bytes
    encoding: str
    attachment: bytes

    def to_bytes(self) -> bytes:
        """Return the file content: header length, CRC-32, header as MessagePack, payload."""
        header = pack({name: value for name, value in asdict(self).items() if name != "payload"})
        return _PREFIX.pack(len(header), crc32(self.payload, crc32(header))) + header + self.payload


@dataclass(slots=True, eq=False)
class SpoolEntry:
    """A queued product: its file, or the product itself if the file could not be written.

    Attributes
    ----------
    size : int
        Bytes.
    failures : int
        Internal errors of the DPM on this product.
    """

    size: int
    path: Path
    product: SpooledProduct | None = None
    failures: int = 0

    def read(self) -> SpooledProduct:
        """Return the product; raises OSError for an unreadable file, CodecError for a corrupt one."""
        if self.product is not None:
            return self.product
        data = self.path.read_bytes()
        try:
            length, checksum = _PREFIX.unpack_from(data)
            if crc32(memoryview(data)[_PREFIX.size :]) != checksum:
                raise CodecError("the CRC-32 does not match")
            end = _PREFIX.size + length
            return SpooledProduct(**unpack(data[_PREFIX.size : end]), payload=data[end:])
        except (TypeError, struct.error, CodecError) as error:
            raise CodecError(f"{self.path}: expected a product: {error}") from error


def capacity_bytes() -> int:
    """Return the spool capacity of one process, ``CDFF_OUTBOX_MB``; raises ConfigurationError."""
    text = os.environ.get("CDFF_OUTBOX_MB", str(DEFAULT_MB))
    if not text.isdecimal() or not int(text):
        raise ConfigurationError(f"CDFF_OUTBOX_MB={text!r}: expected whole megabytes, at least 1")
    return int(text) * 1_000_000


class Spool:
    """Products of some DPFCs, oldest first, below ``{folder}/{robot}/{dfpc}.outbox``.

    A kill of the process loses none. Files are not synced one by one: a loss of power may cost the seconds
    that the kernel has not yet written. Not thread-safe.

    Parameters
    ----------
    folder : Path
    owners : iterable of (robot, DFPC)
        DFPCs whose files of earlier processes are queued.
    capacity : int
        Bytes, at least 4096 for each product; beyond it the oldest are dropped and counted.

    Attributes
    ----------
    dropped : int
        Products dropped because the spool was full.
    bytes : int
        Size of the queue.
    """

    def __init__(self, folder: Path, owners: Iterable[tuple[str, str]], capacity: int) -> None:
        self.dropped = self.bytes = 0
        self._folder, self._capacity = folder, capacity
        self._in_memory = False  # logged once until files can be written again
        self._entries: deque[SpoolEntry] = deque()
        paths = [
            path
            for owner in owners
            for path in self._outbox(*owner).glob("*")
            if path.name.split(".")[0].isdecimal()
        ]
        self._last = 0
        for path in sorted(paths, key=lambda p: p.name):
            if path.suffix == _PART:  # left by a process killed while writing
                _remove(path)
            elif path.suffix == _SUFFIX:
                self._last = int(path.stem)
                self._append(path.stat().st_size, path)

    def __len__(self) -> int:
        return len(self._entries)

    def add(self, product: SpooledProduct) -> None:
        """Append a product; it stays in memory if its file cannot be written."""
        self._last = max(self._last + 1, wall_ns())  # file names in order of arrival, also over restarts
        path = self._outbox(product.robot, product.dfpc) / f"{self._last:020d}{_SUFFIX}"
        data = product.to_bytes()
        try:
            replace_file(path, data)
        except OSError as error:
            if not self._in_memory:
                logger.warning("products wait in memory only: %s", error)
            self._in_memory = True
            self._append(len(data), path, product)
        else:
            self._in_memory = False
            self._append(len(data), path)

    def first(self) -> SpoolEntry:
        """Return the oldest entry; raises IndexError if the spool is empty."""
        return self._entries[0]

    def remove(self, entry: SpoolEntry) -> None:
        """Remove the first entry, unless it was dropped meanwhile."""
        if self._entries and self._entries[0] is entry:
            self._remove_first()

    def postpone(self, entry: SpoolEntry) -> None:
        """Move the first entry to the end, unless it was dropped meanwhile."""
        if self._entries and self._entries[0] is entry:
            self._entries.rotate(-1)

    def _append(self, size: int, path: Path, product: SpooledProduct | None = None) -> None:
        entry = SpoolEntry(max(size, _MIN_BYTES), path, product)
        self._entries.append(entry)
        self.bytes += entry.size
        while self.bytes > self._capacity and len(self._entries) > 1:
            if not self.dropped:
                logger.error(
                    "the outbox is full at %d bytes: the oldest products are dropped", self._capacity
                )
            self._remove_first()
            self.dropped += 1

    def _remove_first(self) -> None:
        entry = self._entries.popleft()
        self.bytes -= entry.size
        if entry.product is None:
            _remove(entry.path)

    def _outbox(self, robot: str, dfpc: str) -> Path:
        return self._folder / robot / f"{dfpc}.outbox"


def _remove(path: Path) -> None:
    """Remove a file; a file that stays is put again by the next process, which is a no-op in the DPM."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        logger.warning("%s is not removed: %s", path, error)


def spool_folder() -> Path:
    """Return the folder of the outboxes, ``CDFF_DATA_DIR/dfpc``.

    It also contains the checkpoint file of each DFPC, ``{robot}/{dfpc}.state``.
    """
    return data_dir_of() / "dfpc"
