# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ports of ROCK in a log: their samples by number, each with its stamp."""

from __future__ import annotations

import zlib
from array import array
from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import CodecError, InputError
from cdff_dev.logs.byte_files import LogFiles, mapped_file
from cdff_dev.logs.formats.pocolog.blocks import StreamBlocks
from cdff_dev.logs.formats.pocolog.decoding import (
    Compound,
    Fixed,
    Type,
    Vector,
    decode_field,
    decode_sample,
)
from cdff_dev.logs.indexed import IndexedStream
from cdff_dev.logs.source import recorded_header
from services.rock_types.values import Conversion, Converted, Source, plain, stamp_ns

#: Largest size of a compressed sample after decompression.
_MAX_DECOMPRESSED = 256 << 20
_TIME_FIELD = "time"


@dataclass(frozen=True, slots=True)
class PortPart:
    """Samples of a port in one file.

    Attributes
    ----------
    file : int
        Number of the file in the log.
    order : str
        Byte order of the samples.
    kind : Type
        Type of the samples, as defined in this file.
    blocks : StreamBlocks
    """

    file: int
    order: str
    kind: Type
    blocks: StreamBlocks


class Port:
    """Samples of a port in all files of a log.

    A sample has the stamp of its own field ``time``, if it has one that is set, else the logical time of its
    block. If the port writes vectors of a type that has a conversion, each element is a sample.

    Parameters
    ----------
    paths : list of Path
        Files of the log.
    parts : list of PortPart
        In order.
    is_split : bool
        Whether each element of a vector is a sample.
    """

    def __init__(self, paths: list[Path], files: LogFiles, parts: list[PortPart], *, is_split: bool) -> None:
        self._paths, self._files, self._parts, self._is_split = paths, files, parts, is_split
        self._first = [0, *accumulate(len(part.blocks.starts) for part in parts)]
        self._blocks = array("q")
        self._elements = array("q")
        self._last: tuple[int, Any] = (-1, None)
        stamps = array("q")
        for part, first in zip(parts, self._first, strict=False):
            self._index(part, first, stamps)
        self.stamps_ns: NDArray[np.int64] = np.array(stamps, np.int64)

    def stream(self, name: str, task: str, conversion: Conversion) -> IndexedStream:
        """Return the samples, converted, as a stream."""
        last: tuple[int, Converted] = (-1, (None, "", None))

        def converted(number: int) -> Converted:
            nonlocal last
            if last[0] != number:
                last = number, self._convert(number, task, conversion)
            return last[1]

        def header(number: int) -> Any:
            _, frame, child = converted(number)
            stamp = int(self.stamps_ns[number])
            return recorded_header(name, number, stamp, frame=frame, child=child, producer=task)

        return IndexedStream(
            conversion.type_name, self.stamps_ns, lambda number: converted(number)[0], header
        )

    def plain_stream(self, type_name: str, field: str = "") -> IndexedStream:
        """Return the samples, or a field of them, without conversion as a stream of a type of ROCK."""

        def read(number: int) -> Any:
            with self._error_context(number) as (value, _):
                return plain(value[field] if field else value)

        return IndexedStream(type_name, self.stamps_ns, read)

    def _index(self, part: PortPart, first: int, stamps: array[int]) -> None:
        """Add the samples of a file: their blocks, elements and stamps."""
        blocks = part.blocks
        element = part.kind.element if self._is_split and isinstance(part.kind, Vector) else part.kind
        has_time = _has_time(element)
        with mapped_file(self._paths[part.file]) as mapped:
            for i, (start, size, logical_us) in enumerate(
                zip(blocks.starts, blocks.sizes, blocks.logical_us, strict=True)
            ):
                stamps_ns = [logical_us * 1000]
                if has_time or self._is_split:
                    content = mapped.data.data[start : start + size]
                    stamps_ns = self._own_stamps(
                        part, content, bool(blocks.compressed[i]), stamps_ns[0], has_time
                    )
                stamps.extend(stamps_ns)
                self._blocks.extend([first + i] * len(stamps_ns))
                self._elements.extend(range(len(stamps_ns)))
                mapped.release_before(start)

    def _own_stamps(
        self, part: PortPart, data: memoryview, is_compressed: bool, logical_ns: int, has_time: bool
    ) -> list[int]:
        """Return the stamps of the samples of a block; of damaged ones, that of the block."""
        try:
            content = decompressed(data.tobytes()) if is_compressed else data
            if not self._is_split:
                time = decode_field(part.kind, _TIME_FIELD, content, part.order)
                return [stamp_ns(time) or logical_ns]
            elements = decode_sample(part.kind, content, part.order)
            return [(stamp_ns(e[_TIME_FIELD]) if has_time else None) or logical_ns for e in elements]
        except CodecError:
            return [logical_ns]

    def _convert(self, number: int, task: str, conversion: Conversion) -> Converted:
        with self._error_context(number) as (value, order):
            return conversion.convert(value, Source(task, int(self.stamps_ns[number]), order))

    @contextmanager
    def _error_context(self, number: int) -> Iterator[tuple[Any, str]]:
        """Yield the value of a sample and its byte order; errors name the file and the sample."""
        part, i = self._block(number)
        try:
            value = self._value(self._blocks[number], part, i)
            yield (value[self._elements[number]] if self._is_split else value), part.order
        except (InputError, ValueError, TypeError, KeyError, IndexError, OverflowError) as error:
            where = f"{part.blocks.name} sample at byte {part.blocks.starts[i]}"
            raise CodecError(f"{self._paths[part.file]}: {where}: {error}") from error

    def _block(self, number: int) -> tuple[PortPart, int]:
        """Return the file of a sample, and the number of its block in the file."""
        k = bisect_right(self._first, self._blocks[number]) - 1
        return self._parts[k], self._blocks[number] - self._first[k]

    def _value(self, block: int, part: PortPart, i: int) -> Any:
        """Return the value of a block; the last one is kept, as several streams and elements need it."""
        if self._last[0] != block:
            start = part.blocks.starts[i]
            data = self._files.read(part.file, start, start + part.blocks.sizes[i])
            content = decompressed(data) if part.blocks.compressed[i] else data
            self._last = block, decode_sample(part.kind, content, part.order)
        return self._last[1]


def decompressed(data: bytes) -> bytes:
    """Return a sample without compression; raises CodecError if it is damaged or larger than 256 MiB."""
    stream = zlib.decompressobj()
    try:
        content = stream.decompress(data, _MAX_DECOMPRESSED)
    except zlib.error as error:
        raise CodecError(f"compressed sample: {error}") from error
    if not stream.eof:
        raise CodecError(
            f"compressed sample: {len(content)} bytes before its end, expected at most {_MAX_DECOMPRESSED}"
        )
    return content


def _has_time(kind: Type) -> bool:
    """Return whether a type has a field ``time`` of ``base::Time``."""
    dtype = None
    if isinstance(kind, Compound):
        member = next((member for _, name, member in kind.members if name == _TIME_FIELD), None)
        dtype = member.dtype if isinstance(member, Fixed) else None
    elif isinstance(kind, Fixed) and _TIME_FIELD in (kind.dtype.names or ()):
        dtype = kind.dtype[_TIME_FIELD]
    return dtype is not None and "microseconds" in (dtype.names or ())
