# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products that the DPM has not acknowledged, as files: a process that ends leaves them to the next one."""

from __future__ import annotations

import logging
import os
import struct
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from zlib import crc32

from cdff_common.bus.message import pack, unpack
from cdff_common.clock import wall_ns
from cdff_common.errors import CodecError, ConfigurationError
from cdff_common.process import data_dir_of

logger = logging.getLogger(__name__)

#: How much may wait without ``CDFF_OUTBOX_MB``.
DEFAULT_MB = 256
_SUFFIX = ".parcel"
_PART = ".part"
#: Length of the head; CRC-32 of the head and the payload.
_BEGIN = struct.Struct("<II")
#: What a parcel counts at least: a block of the disk, more than it takes of memory beside its payload.
_LEAST_BYTES = 4096


@dataclass(frozen=True, slots=True)
class Parcel:
    """An encoded product."""

    robot: str
    dfpc: str
    port: str
    product: str
    payload: bytes
    encoding: str
    attachment: bytes


@dataclass(slots=True, eq=False)
class Waiting:
    """A parcel that waits: its file, or itself where it could not be written."""

    size: int
    path: Path
    parcel: Parcel | None = None
    #: How often the DPM broke on it.
    failures: int = 0


def capacity_bytes() -> int:
    """What may wait on this machine for one process: ``CDFF_OUTBOX_MB``; raises ConfigurationError on no such size."""
    text = os.environ.get("CDFF_OUTBOX_MB", str(DEFAULT_MB))
    if not text.isdecimal() or not int(text):
        raise ConfigurationError(f"CDFF_OUTBOX_MB={text!r}: expected whole megabytes, at least 1")
    return int(text) * 1_000_000


class Spool:
    """Parcels of some DFPCs, oldest first, below ``{folder}/{robot}/{dfpc}.outbox``.

    A kill of the process loses none. Files are not synced one by one: what a loss of power may cost is the seconds that
    the kernel had not written yet. Not safe to use from several threads.

    Parameters
    ----------
    folder : Path
    owners : iterable of (robot, DFPC)
        Whose parcels are taken up from before.
    capacity : int
        Bytes, at least 4096 for each parcel; beyond it the oldest are dropped and counted.

    Attributes
    ----------
    dropped : int
        Parcels that went for want of room.
    bytes : int
        What waits.
    """

    def __init__(self, folder: Path, owners: Iterable[tuple[str, str]], capacity: int) -> None:
        self.dropped = self.bytes = 0
        self._folder, self._capacity = folder, capacity
        self._in_memory = False  # said once until files can be written again
        self._waiting: deque[Waiting] = deque()
        found = [path for owner in owners for path in self._of(*owner).glob("*") if path.stem.isdecimal()]
        self._last = 0
        for path in sorted(found, key=lambda p: p.name):
            if path.suffix == _PART:  # of a process that was killed as it wrote
                _remove(path)
            elif path.suffix == _SUFFIX:
                self._last = int(path.stem)
                self._append(path.stat().st_size, path)

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, parcel: Parcel) -> None:
        """Put a parcel behind the others; where its file cannot be written it waits in memory."""
        self._last = max(self._last + 1, wall_ns())  # names in the order of arrival, over restarts too
        path = self._of(parcel.robot, parcel.dfpc) / f"{self._last:020d}{_SUFFIX}"
        data = packed(parcel)
        part = path.with_suffix(_PART)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            part.write_bytes(data)
            part.replace(path)
        except OSError as error:
            if not self._in_memory:
                logger.warning("products wait in memory only: %s", error)
            self._in_memory = True
            with suppress(OSError):
                part.unlink()
            self._append(len(data), path, parcel)
        else:
            self._in_memory = False
            self._append(len(data), path)

    def first(self) -> Waiting:
        """The parcel that waits longest; raises IndexError where none does."""
        return self._waiting[0]

    def done(self, waiting: Waiting) -> None:
        """Let a parcel go, unless it was dropped meanwhile."""
        if self._waiting and self._waiting[0] is waiting:
            self._go()

    def postpone(self, waiting: Waiting) -> None:
        """Put a parcel behind the others, unless it was dropped meanwhile."""
        if self._waiting and self._waiting[0] is waiting:
            self._waiting.rotate(-1)

    def _append(self, size: int, path: Path, parcel: Parcel | None = None) -> None:
        waiting = Waiting(max(size, _LEAST_BYTES), path, parcel)
        self._waiting.append(waiting)
        self.bytes += waiting.size
        while self.bytes > self._capacity and len(self._waiting) > 1:
            if not self.dropped:
                logger.error("the outbox is full at %d bytes: the oldest products are dropped", self._capacity)
            self._go()
            self.dropped += 1

    def _go(self) -> None:
        waiting = self._waiting.popleft()
        self.bytes -= waiting.size
        if waiting.parcel is None:
            _remove(waiting.path)

    def _of(self, robot: str, dfpc: str) -> Path:
        return self._folder / robot / f"{dfpc}.outbox"


def _remove(path: Path) -> None:
    """Remove a file; one that stays is handed over again by the next process, which the DPM takes for the same."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        logger.warning("%s stays: %s", path, error)


def packed(parcel: Parcel) -> bytes:
    """A parcel as a file: length of the head, CRC-32 of what follows, the head as MessagePack, the payload."""
    head = pack({name: value for name, value in asdict(parcel).items() if name != "payload"})
    return _BEGIN.pack(len(head), crc32(parcel.payload, crc32(head))) + head + parcel.payload


def opened(waiting: Waiting) -> Parcel:
    """The parcel itself; raises OSError where its file cannot be read, CodecError where it holds none."""
    if waiting.parcel is not None:
        return waiting.parcel
    data = waiting.path.read_bytes()
    try:
        length, checksum = _BEGIN.unpack_from(data)
        if crc32(memoryview(data)[_BEGIN.size :]) != checksum:
            raise CodecError("its CRC-32 is not the one written with it")
        begin = _BEGIN.size + length
        return Parcel(**unpack(data[_BEGIN.size : begin]), payload=data[begin:])
    except (TypeError, struct.error, CodecError) as error:
        raise CodecError(f"{waiting.path}: expected a parcel: {error}") from error


def spool_folder() -> Path:
    """Where the outboxes of this machine lie, below ``CDFF_DATA_DIR``, beside the DFPCs' states."""
    return data_dir_of() / "dfpc"
