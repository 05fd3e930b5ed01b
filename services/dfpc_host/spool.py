# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of products that the DPM has not acknowledged; they survive the end of the process."""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from cdff_common.clock import wall_ns
from cdff_common.errors import CodecError, ConfigurationError
from cdff_common.output import replace_file
from cdff_common.process import data_dir_of
from services.dfpc_host.keep_priority import DEFAULT_PRIORITY, keep_priority
from services.dfpc_host.memory_ledger import MemoryLedger
from services.product_file import product_file, read_product_file

logger = logging.getLogger(__name__)

#: Default of ``CDFF_OUTBOX_MB``, megabytes.
DEFAULT_MB = 256
_SUFFIX = ".product"
_PART = ".part"
_LEDGER = "memory.count"
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
        """Return the content of its file."""
        fields = {name: value for name, value in asdict(self).items() if name != "payload"}
        return product_file(fields, self.payload)


@dataclass(slots=True, eq=False)
class SpoolEntry:
    """A queued product: its file, or the product itself if the file could not be written.

    Attributes
    ----------
    size : int
        Bytes.
    priority : int
        See ``keep_priority``.
    failures : int
        Failures of the DPM on this product.
    """

    size: int
    path: Path
    product: SpooledProduct | None = None
    priority: int = DEFAULT_PRIORITY
    failures: int = 0

    def read(self) -> SpooledProduct:
        """Return the product; raises OSError for an unreadable file, CodecError for a corrupt one."""
        if self.product is not None:
            return self.product
        header, payload = read_product_file(self.path)
        try:
            return SpooledProduct(**header, payload=payload)
        except TypeError as error:
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
        Bytes, at least 4096 for each product; beyond it the least valuable are dropped and counted, of these
        the oldest.

    Attributes
    ----------
    dropped : int
        Products dropped because the spool was full.
    in_memory : int
        Products of which only the memory has a copy, because their file could not be written.
    lost : int
        Products that the previous process had only in memory when it ended.
    bytes : int
        Size of the queue.
    """

    def __init__(self, folder: Path, owners: Iterable[tuple[str, str]], capacity: int) -> None:
        self.dropped = self.bytes = self.in_memory = 0
        self._folder, self._capacity = folder, capacity
        self._in_memory: dict[tuple[str, str], int] = {}
        self._ledgers: dict[tuple[str, str], MemoryLedger] = {}
        self._entries: deque[SpoolEntry] = deque()
        owners = list(owners)
        paths = [
            path
            for owner in owners
            for path in self._outbox(*owner).glob("*")
            if path.name.split(".")[0].isdecimal()
        ]
        self._last = 0
        for path in sorted(paths, key=lambda p: p.name):
            if path.suffix == _PART:  # left by a process killed while writing
                _remove_file(path)
            elif path.suffix == _SUFFIX:
                number, *priority = path.stem.split(".")
                self._last = int(number)
                self._append(
                    path.stat().st_size, path, priority=int(priority[0]) if priority else DEFAULT_PRIORITY
                )
        self._ledgers = {owner: MemoryLedger(self._outbox(*owner) / _LEDGER) for owner in owners}
        self.lost = sum(ledger.previous for ledger in self._ledgers.values())
        if self.lost:
            logger.error(
                "%d products were only in memory when the last process ended: they are lost", self.lost
            )

    def __len__(self) -> int:
        return len(self._entries)

    def add(self, product: SpooledProduct) -> None:
        """Append a product; it stays in memory if its file cannot be written."""
        self._last = max(self._last + 1, wall_ns())  # file names in order of arrival, also over restarts
        priority = keep_priority(product.product)
        path = self._outbox(product.robot, product.dfpc) / f"{self._last:020d}.{priority}{_SUFFIX}"
        data = product.to_bytes()
        try:
            replace_file(path, data)
        except OSError as error:
            if not self.in_memory:
                logger.error("products wait in memory only, a kill would lose them: %s", error)
            self._append(len(data), path, product, priority)
        else:
            self._append(len(data), path, priority=priority)
            if self.in_memory:  # the disk has space again
                self.write_out()

    def write_out(self) -> None:
        """Write the products that are only in memory to files, the most valuable first, while possible."""
        waiting = [entry for entry in self._entries if entry.product is not None]
        for entry in sorted(waiting, key=lambda entry: -entry.priority):
            assert entry.product is not None
            try:
                replace_file(entry.path, entry.product.to_bytes())
            except OSError:
                return
            self._count_in_memory(entry.product, -1)
            entry.product = None

    def first(self) -> SpoolEntry:
        """Return the oldest entry; raises IndexError if the spool is empty."""
        return self._entries[0]

    def remove(self, entry: SpoolEntry) -> None:
        """Remove the first entry, unless it was dropped meanwhile."""
        if self._entries and self._entries[0] is entry:
            self._remove(entry)

    def postpone(self, entry: SpoolEntry) -> None:
        """Move the first entry to the end, unless it was dropped meanwhile."""
        if self._entries and self._entries[0] is entry:
            self._entries.rotate(-1)

    def _append(
        self, size: int, path: Path, product: SpooledProduct | None = None, priority: int = DEFAULT_PRIORITY
    ) -> None:
        entry = SpoolEntry(max(size, _MIN_BYTES), path, product, priority)
        self._entries.append(entry)
        self.bytes += entry.size
        if product is not None:
            self._count_in_memory(product, 1)
        while self.bytes > self._capacity and len(self._entries) > 1:
            if not self.dropped:
                logger.error(
                    "the outbox is full at %d bytes: the least valuable products are dropped", self._capacity
                )
            self._remove(
                min(self._entries, key=lambda entry: entry.priority)
            )  # the first, oldest, of the smallest
            self.dropped += 1

    def _remove(self, entry: SpoolEntry) -> None:
        self._entries.remove(entry)
        self.bytes -= entry.size
        if entry.product is None:
            _remove_file(entry.path)
        else:
            self._count_in_memory(entry.product, -1)

    def _count_in_memory(self, product: SpooledProduct, change: int) -> None:
        """Change the number of products that are only in memory by ``change``, and note it for the next process."""
        owner = product.robot, product.dfpc
        self._in_memory[owner] = self._in_memory.get(owner, 0) + change
        self.in_memory += change
        if owner in self._ledgers:
            self._ledgers[owner].set(self._in_memory[owner])

    def _outbox(self, robot: str, dfpc: str) -> Path:
        return self._folder / robot / f"{dfpc}.outbox"


def _remove_file(path: Path) -> None:
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
