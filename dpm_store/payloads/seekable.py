# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Zstandard's seekable format: frames of equal content size, and a table of their sizes at the end.

Each frame is decompressed without the others, and ``zstd -d`` decompresses the whole file. Source: zstd,
``contrib/seekable_format/zstd_seekable_compression_format.md``.
"""

from __future__ import annotations

import struct
from typing import BinaryIO

import zstandard

from cdff_common.errors import CodecError

#: Level of compression, the fastest one of the library's defaults.
LEVEL = 1
#: Start of the frame that holds the table, and end of the table.
_SKIPPABLE_MAGIC, _SEEKABLE_MAGIC = 0x184D2A5E, 0x8F92EAB1
_HEADER, _ENTRY, _FOOTER = struct.Struct("<II"), struct.Struct("<II"), struct.Struct("<IBI")


def compress(content: bytes, frame_bytes: int) -> bytes:
    """Return the content in frames of ``frame_bytes`` each, the last one shorter, with their table."""
    view = memoryview(content)
    parts = [view[i : i + frame_bytes] for i in range(0, len(view), frame_bytes)]
    compressor = zstandard.ZstdCompressor(level=LEVEL, write_content_size=True)
    frames = [compressor.compress(part) for part in parts]
    table = b"".join(
        _ENTRY.pack(len(frame), len(part)) for frame, part in zip(frames, parts, strict=True)
    ) + _FOOTER.pack(len(frames), 0, _SEEKABLE_MAGIC)
    return b"".join([*frames, _HEADER.pack(_SKIPPABLE_MAGIC, len(table)), table])


def read_frames(file: BinaryIO, file_bytes: int, content_bytes: int, first: int, last: int) -> bytes:
    """Return the content of the frames ``first`` to ``last`` (exclusive).

    Parameters
    ----------
    file : binary file
        Result of ``compress`` from position 0.
    file_bytes, content_bytes : int
        Size of the file, and of the content that it must have.

    Raises
    ------
    CodecError
        If the file is damaged or has another content size; at most ``content_bytes`` are decompressed.
    """
    starts, sizes = _frames(file, file_bytes, content_bytes)
    if len(sizes) < last:
        raise CodecError(f"{len(sizes)} compressed frames: expected {last} or more")
    file.seek(starts[first])
    data = memoryview(file.read(starts[last] - starts[first]))
    decompressor = zstandard.ZstdDecompressor()
    contents = []
    for i in range(first, last):
        frame = data[starts[i] - starts[first] : starts[i + 1] - starts[first]]
        try:
            stated_size = zstandard.get_frame_parameters(frame).content_size
            content = decompressor.decompress(frame) if stated_size == sizes[i] else b""
        except zstandard.ZstdError as error:
            raise CodecError(f"compressed frame {i}: {error}") from error
        if len(content) != sizes[i]:
            raise CodecError(f"compressed frame {i}: {stated_size} bytes of content, expected {sizes[i]}")
        contents.append(content)
    return contents[0] if len(contents) == 1 else b"".join(contents)


def _frames(file: BinaryIO, file_bytes: int, content_bytes: int) -> tuple[list[int], list[int]]:
    """Return the start of each frame and the end of the last one, and the content size of each."""
    file.seek(max(file_bytes - _FOOTER.size, 0))
    footer = file.read(_FOOTER.size)
    if len(footer) != _FOOTER.size:
        raise CodecError(f"{file_bytes} bytes: too short for a table of compressed frames")
    count, descriptor, magic = _FOOTER.unpack(footer)
    table_bytes = _HEADER.size + count * _ENTRY.size + _FOOTER.size
    if magic != _SEEKABLE_MAGIC or descriptor or table_bytes > file_bytes:
        raise CodecError(f"no table of compressed frames at the end of {file_bytes} bytes")
    file.seek(file_bytes - table_bytes)
    table = file.read(table_bytes)
    starts, sizes = [0], []
    for compressed, size in _ENTRY.iter_unpack(table[_HEADER.size : -_FOOTER.size]):
        starts.append(starts[-1] + compressed)
        sizes.append(size)
    if starts[-1] + table_bytes != file_bytes or sum(sizes) != content_bytes:
        raise CodecError(
            f"compressed frames of {starts[-1]} bytes with {sum(sizes)} bytes of content: expected "
            f"{file_bytes - table_bytes} bytes with {content_bytes}"
        )
    return starts, sizes
