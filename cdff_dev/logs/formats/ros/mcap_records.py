# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Records of an MCAP file, read in their order, without its index (https://mcap.dev/spec)."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

from cdff_common.errors import CodecError
from cdff_dev.logs.formats.ros.recording import PARSER_ERRORS

MAGIC = b"\x89MCAP0\r\n"
#: Largest record and decompressed chunk; writers make chunks of some megabytes.
_MAX_BYTES = 256 << 20
_PREFIX = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
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
        with path.open("rb") as file:
            head = file.read(len(MAGIC))
        if head != MAGIC:
            raise CodecError(f"{path}: byte 0: {head!r}, expected the start of an MCAP file, {MAGIC!r}")

    def __iter__(self) -> Iterator[Record]:
        """Yield schemas, channels, and messages as number of the channel, time of recording and content."""
        self.attachments = 0
        with self._path.open("rb") as file:
            size = file.seek(0, io.SEEK_END)
            at = file.seek(len(MAGIC))
            while True:
                found = self._next(file, at, size)
                if found is None:
                    return
                opcode, body, after = found
                try:
                    yield from self._records(opcode, body)
                except _ERRORS as error:
                    self._report(at, f"damaged record of type {opcode}: {error}")
                at = after

    def _next(self, file: BinaryIO, at: int, size: int) -> tuple[int, bytes, int] | None:
        """Return type, content and end of the record at an offset; None at the end of the data."""
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
            self._report(at, f"a record of {length} bytes, of which the file has {size - at - _PREFIX.size}")
            return None
        if opcode == Opcode.ATTACHMENT:
            self.attachments += 1
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK):
            return opcode, b"", after
        if length > _MAX_BYTES:
            self._report(at, f"a record of {length} bytes, expected at most {_MAX_BYTES}")
            return opcode, b"", after
        return opcode, file.read(length), after

    def _records(self, opcode: int, body: bytes) -> Iterator[Record]:
        if not body:
            return
        if opcode == Opcode.CHUNK:
            yield from _chunk_records(_decompressed(Chunk.read(ReadDataStream(io.BytesIO(body)))))
        else:
            yield from _record(opcode, memoryview(body))


def _chunk_records(data: memoryview) -> Iterator[Record]:
    at = 0
    while at < len(data):
        opcode, length = _PREFIX.unpack_from(data, at)
        at += _PREFIX.size
        if length > len(data) - at:
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


def _decompressed(chunk: Chunk) -> memoryview:
    """Return the records of a chunk; raises ValueError if size or checksum differ."""
    size = chunk.uncompressed_size
    if size > _MAX_BYTES:
        raise ValueError(f"a chunk of {size} bytes, expected at most {_MAX_BYTES}")
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(chunk.data)).read(size)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise ValueError(f"compression {chunk.compression!r}, expected zstd, lz4 or none")
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes in a chunk, expected {size}")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("checksum of a chunk differs")
    return memoryview(data)
