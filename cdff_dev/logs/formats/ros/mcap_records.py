# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Records of an MCAP file, read in their order, without its index (https://mcap.dev/spec)."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from cdff_common.errors import CodecError
from cdff_dev.logs.formats.ros.recording import PARSER_ERRORS

MAGIC = b"\x89MCAP0\r\n"
#: Largest record and decompressed chunk; writers make chunks of some megabytes.
_MAX_BYTES = 256 << 20
_PREFIX = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
#: A chunk: start and end time, size and checksum of its records, size of the name of the compression.
_CHUNK, _SIZE = struct.Struct("<QQQII"), struct.Struct("<Q")
_ERRORS = (*PARSER_ERRORS, McapError, zstandard.ZstdError)

Record = Schema | Channel | tuple[int, int, memoryview]


class McapRecords:
    """Schemas, channels and messages of a file up to its end or damage.

    The summary at the end repeats schemas and channels, which helps if their first chunk is damaged.

    Parameters
    ----------
    path : Path
    report : callable
        Called with offset and reason for each damaged part that is left out.

    Raises
    ------
    CodecError
        If it is not an MCAP file.
    """

    def __init__(self, path: Path, report: Callable[[int, str], None]) -> None:
        self._path, self._report = path, report
        self.attachments = 0
        self._channels_of: dict[int, frozenset[int]] = {}
        with path.open("rb") as file:
            head = file.read(len(MAGIC))
        if head != MAGIC:
            raise CodecError(f"{path}: byte 0: {head!r}, expected the start of an MCAP file, {MAGIC!r}")

    def __iter__(self) -> Iterator[Record]:
        """Yield all records, see ``records``."""
        return self.records()

    def records(self, wanted: Collection[int] | None = None) -> Iterator[Record]:
        """Yield schemas, channels, and messages as number of the channel, time of recording and content.

        After a complete pass, chunks without messages of ``wanted`` channels are not read again, and the
        checksums of the others are not compared again.
        """
        self.attachments = 0
        with self._path.open("rb") as file:
            size = file.seek(0, io.SEEK_END)
            at = file.seek(len(MAGIC))
            while True:
                known = self._channels_of.get(at)
                is_needed = known is None or wanted is None or not known.isdisjoint(wanted)
                next_record = self._next(file, at, size, is_needed)
                if next_record is None:
                    return
                opcode, body, after = next_record
                try:
                    yield from self._records(at, opcode, body, is_complete=after <= size)
                except _ERRORS as error:
                    self._report(at, f"damaged record of type {opcode}: {error}")
                if after > size:
                    return
                at = after

    def _next(
        self, file: BinaryIO, at: int, size: int, is_needed: bool
    ) -> tuple[int, memoryview, int] | None:
        """Return type, content if it is needed, and end of a record; None at the end of the data.

        The end of a chunk that the file does not contain completely is after that of the file.
        """
        file.seek(at)
        prefix = file.read(_PREFIX.size)
        if len(prefix) < _PREFIX.size:
            self._report(at, "the file ends without a footer")
            return None
        opcode, length = _PREFIX.unpack(prefix)
        after = at + _PREFIX.size + length
        if opcode == Opcode.FOOTER:
            return None
        if after > size:
            has, read = (
                size - at - _PREFIX.size,
                "; it is read up to the end" if opcode == Opcode.CHUNK else "",
            )
            self._report(at, f"a record of {length} bytes, of which the file has {has}{read}")
            if opcode != Opcode.CHUNK or has > _MAX_BYTES:
                return None
            return opcode, memoryview(file.read(has) if is_needed else b""), after
        if opcode == Opcode.ATTACHMENT:
            self.attachments += 1
        if not is_needed or opcode not in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK):
            return opcode, memoryview(b""), after
        if length > _MAX_BYTES:
            self._report(at, f"a record of {length} bytes, expected at most {_MAX_BYTES}")
            return opcode, memoryview(b""), after
        return opcode, memoryview(file.read(length)), after

    def _records(self, at: int, opcode: int, body: memoryview, *, is_complete: bool) -> Iterator[Record]:
        if not body:
            return
        if opcode != Opcode.CHUNK:
            yield from _record(opcode, body)
            return
        channels: set[int] = set()
        data = _decompressed(body, is_verified=at in self._channels_of) if is_complete else _beginning(body)
        for record in _chunk_records(data, is_complete=is_complete):
            if isinstance(record, tuple):
                channels.add(record[0])
            yield record
        self._channels_of[at] = frozenset(channels)


def _chunk_records(data: memoryview, *, is_complete: bool) -> Iterator[Record]:
    """Yield the records of a chunk; an incomplete one is only accepted at the end of an incomplete chunk."""
    at = 0
    while at < len(data):
        if not is_complete and len(data) - at < _PREFIX.size:
            return
        opcode, length = _PREFIX.unpack_from(data, at)
        at += _PREFIX.size
        if length > len(data) - at:
            if not is_complete:
                return
            raise ValueError(f"a record of {length} bytes at byte {at} of a chunk of {len(data)}")
        yield from _record(opcode, data[at : at + length])
        at += length


def _record(opcode: int, body: memoryview) -> Iterator[Record]:
    if opcode == Opcode.MESSAGE:
        channel, _, recorded_ns, _ = _MESSAGE.unpack_from(body)
        yield channel, recorded_ns, body[_MESSAGE.size :]
    elif opcode == Opcode.SCHEMA:
        yield Schema.read(ReadDataStream(io.BytesIO(bytes(body))))
    elif opcode == Opcode.CHANNEL:
        yield Channel.read(ReadDataStream(io.BytesIO(bytes(body))))


def _decompressed(body: memoryview, is_verified: bool) -> memoryview:
    """Return the records of a chunk; raises ValueError if size or checksum differ."""
    size, checksum, compression, data_size, at = _chunk_header(body)
    if data_size > len(body) - at:
        raise ValueError(f"{data_size} bytes of records in a chunk that has {len(body) - at}")
    chunk = body[at : at + data_size]
    data: bytes | memoryview
    if compression == "zstd":
        data = zstandard.ZstdDecompressor().stream_reader(chunk).read(size)
    elif compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk, max_length=size)
    elif compression == "":
        data = chunk
    else:
        raise ValueError(f"compression {compression!r}, expected zstd, lz4 or none")
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes in a chunk, expected {size}")
    if checksum and not is_verified and zlib.crc32(data) != checksum:
        raise ValueError("checksum of a chunk differs")
    return memoryview(data)


def _beginning(body: memoryview) -> memoryview:
    """Return the records at the start of a chunk whose end is missing, without a check."""
    size, _, compression, _, at = _chunk_header(body)
    data: bytes | memoryview = body[at:]
    if compression == "zstd":
        data = zstandard.ZstdDecompressor().decompressobj().decompress(data)
    elif compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
    return memoryview(data)[:size]


def _chunk_header(body: memoryview) -> tuple[int, int, str, int, int]:
    """Return size and checksum of the records of a chunk, their compression, compressed size and offset."""
    _, _, size, checksum, name_size = _CHUNK.unpack_from(body)
    at = _CHUNK.size + name_size
    compression = bytes(body[_CHUNK.size : at]).decode("utf-8")
    (data_size,) = _SIZE.unpack_from(body, at)
    if size > _MAX_BYTES:
        raise ValueError(f"a chunk of {size} bytes, expected at most {_MAX_BYTES}")
    return size, checksum, compression, data_size, at + _SIZE.size
