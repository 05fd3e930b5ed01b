# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Records of a ROS 1 bag, read in their order (http://wiki.ros.org/Bags/Format/2.0)."""

from __future__ import annotations

import bz2
import io
import struct
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]

from cdff_common.errors import CodecError
from cdff_dev.logs.formats.ros.bag1_fields import (
    LENGTH,
    Bag1Connection,
    connection,
    fields,
    next_chunk,
    text,
)
from cdff_dev.logs.formats.ros.recording import PARSER_ERRORS

MAGIC = b"#ROSBAG V2.0\n"
#: Largest chunk or message, and largest header of a record.
_MAX_BYTES, _MAX_HEADER = 256 << 20, 1 << 20
_MESSAGE, _HEADER, _CHUNK, _CHUNK_INFO, _CONNECTION = b"\x02", b"\x03", b"\x05", b"\x06", b"\x07"
_COUNTS = (b"conn_count", b"chunk_count")
_TIME = struct.Struct("<LL")

Record = Bag1Connection | tuple[int, int, memoryview]


@dataclass(frozen=True, slots=True)
class _Header:
    """Header of a record: type, fields, and byte range ``start`` to ``end`` of the data in the file."""

    kind: bytes
    values: dict[bytes, bytes]
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Bag1Index:
    """Index at the end of a bag: connections, and for each chunk by its offset the messages of each."""

    connections: tuple[Bag1Connection, ...]
    chunks: dict[int, dict[int, int]]


class Bag1Records:
    """Connections and messages of a bag up to its end or damage; one chunk is in memory.

    Parameters
    ----------
    path : Path
    report : callable
        Called with offset and reason for each part that is damaged or missing.

    Raises
    ------
    CodecError
        If it is not a bag of version 2.0.
    """

    def __init__(self, path: Path, report: Callable[[int, str], None]) -> None:
        self._path, self._report = path, report
        with path.open("rb") as file:
            head = file.read(len(MAGIC))
            if head != MAGIC:
                raise CodecError(
                    f"{path}: byte 0: {head!r}, expected the start of a ROS 1 bag, {MAGIC!r}; bags of other "
                    "versions are converted by `rosbag fix`"
                )
            self._size = file.seek(0, io.SEEK_END)
            self.index = self._read_index(file)

    def messages(self, wanted: Collection[int] | None = None) -> Iterator[Record]:
        """Yield connections, and messages as connection, time of recording and content.

        With an index and ``wanted`` connections, chunks without messages of these are not read.
        """
        chunks = self.index.chunks if self.index and wanted is not None else {}
        skipped = {at for at, counts in chunks.items() if not any(counts.get(c) for c in wanted or ())}
        index_at, has_end = 0, True
        with self._path.open("rb") as file:
            at = len(MAGIC)
            while at < self._size:
                try:
                    header = self._header(file, at)
                    if header.kind == _HEADER:
                        index_at = int.from_bytes(header.values[b"index_pos"], "little")
                    elif at not in skipped:
                        yield from self._records(file, header)
                except PARSER_ERRORS as error:
                    at, has_end = self._after_damage(file, at, error), False
                else:
                    at = min(header.end, self._size) if header.kind == _CHUNK else header.end
                    has_end = has_end and header.end <= self._size
        if has_end and not 0 < index_at <= self._size:
            self._report(self._size, "the file ends without an index; the recording was not completed")

    def _header(self, file: BinaryIO, at: int) -> _Header:
        """Return the header of the record at an offset; raises one of PARSER_ERRORS if it is damaged."""
        file.seek(at)
        prefix = file.read(LENGTH.size)
        size = int.from_bytes(prefix, "little")
        if size > _MAX_HEADER:
            raise ValueError(f"a header of {size} bytes, expected at most {_MAX_HEADER}")
        data = file.read(size + LENGTH.size)
        if len(prefix + data) < size + 2 * LENGTH.size:
            raise EOFError("a part of the header of a record")
        values = fields(data[:size])
        start = at + size + 2 * LENGTH.size
        end = start + LENGTH.unpack_from(data, size)[0]
        kind = values[b"op"]
        if end > self._size and kind != _CHUNK:
            raise EOFError(f"{self._size - start} of the {end - start} bytes of a record")
        return _Header(kind, values, start, end)

    def _records(self, file: BinaryIO, header: _Header) -> Iterator[Record]:
        if header.kind not in (_CHUNK, _MESSAGE, _CONNECTION):
            return
        if header.end - header.start > _MAX_BYTES:
            raise ValueError(f"{header.end - header.start} bytes, expected at most {_MAX_BYTES}")
        file.seek(header.start)
        data = file.read(header.end - header.start)
        if header.kind != _CHUNK:
            yield from _record(header.kind, header.values, memoryview(data))
            return
        is_whole = header.end <= self._size
        if not is_whole:
            self._report(self._size, "the file ends in a chunk of messages, which is read up to the end")
        size = int.from_bytes(header.values[b"size"], "little")
        yield from _chunk_records(
            _decompressed(header.values[b"compression"], data, size, is_whole), is_whole
        )

    def _after_damage(self, file: BinaryIO, at: int, error: BaseException) -> int:
        """Report damage, and return the offset of the next chunk."""
        following = next_chunk(file, at + 1, self._size)
        if following == self._size and isinstance(error, EOFError):
            self._report(at, f"the file ends, after {error}")
        else:
            until = "the end of the file" if following == self._size else f"the chunk at byte {following}"
            self._report(at, f"damaged up to {until}: {error}")
        return following

    def _read_index(self, file: BinaryIO) -> Bag1Index | None:
        """Return the index, which ends the file; None if it is missing or damaged."""
        connections: list[Bag1Connection] = []
        chunks: dict[int, dict[int, int]] = {}
        try:
            start = self._header(file, len(MAGIC))
            expected = tuple(int.from_bytes(start.values[name], "little") for name in _COUNTS)
            at = int.from_bytes(start.values[b"index_pos"], "little")
            while len(MAGIC) < at < self._size:
                header = self._header(file, at)
                file.seek(header.start)
                data = file.read(header.end - header.start)
                if header.kind == _CONNECTION:
                    connections.append(connection(header.values, data))
                elif header.kind == _CHUNK_INFO:
                    position = int.from_bytes(header.values[b"chunk_pos"], "little")
                    chunks[position] = dict(struct.iter_unpack("<LL", data))
                else:
                    return None
                at = header.end
        except PARSER_ERRORS:
            return None
        is_complete = expected == (len(connections), len(chunks)) and bool(connections)
        return Bag1Index(tuple(connections), chunks) if is_complete else None


def _chunk_records(data: memoryview, is_whole: bool) -> Iterator[Record]:
    at = 0
    while at < len(data):
        try:
            (size,) = LENGTH.unpack_from(data, at)
            (data_size,) = LENGTH.unpack_from(data, at + LENGTH.size + size)
        except struct.error:
            size = data_size = len(data)
        start = at + 2 * LENGTH.size + size
        if start + data_size > len(data):
            if is_whole:
                raise ValueError(f"a record at byte {at} of a chunk of {len(data)} ends after it")
            return
        values = fields(data[at + LENGTH.size : at + LENGTH.size + size])
        yield from _record(values[b"op"], values, data[start : start + data_size])
        at = start + data_size


def _record(kind: bytes, values: dict[bytes, bytes], data: memoryview) -> Iterator[Record]:
    if kind == _MESSAGE:
        sec, nsec = _TIME.unpack(values[b"time"])
        yield int.from_bytes(values[b"conn"], "little"), sec * 1_000_000_000 + nsec, data
    elif kind == _CONNECTION:
        yield connection(values, data)


def _decompressed(compression: bytes, data: bytes, size: int, is_whole: bool) -> memoryview:
    """Return the records of a chunk, or those at its start; raises ValueError if the size differs."""
    if size > _MAX_BYTES:
        raise ValueError(f"a chunk of {size} bytes, expected at most {_MAX_BYTES}")
    if compression == b"none":
        records = data
    elif compression == b"bz2":
        records = bz2.BZ2Decompressor().decompress(data, max_length=max(size, 1))
    elif compression == b"lz4":
        records = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=max(size, 1))
    else:
        raise ValueError(f"compression {text(compression)}, expected none, bz2 or lz4")
    if is_whole and len(records) != size:
        raise ValueError(f"{len(records)} bytes in a chunk, expected {size}")
    return memoryview(records)
