# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Zstandard's seekable format: frames of equal content size, and a table of their sizes at the end.

Each frame is decompressed without the others, and ``zstd -d`` decompresses the whole file. Source: zstd,
``contrib/seekable_format/zstd_seekable_compression_format.md``. A frame contains a checksum of its content
(XXH64, RFC 8878, section 3.1.1), which is compared during the decompression. The sums by which a caller
identifies the content are in a skippable frame before the table.
"""

from __future__ import annotations

import struct
from typing import BinaryIO, NamedTuple

import zstandard

from cdff_common.errors import CodecError

#: Level of compression, the fastest one of the library's defaults.
LEVEL = 1
#: Threads that compress the frames of one content.
_THREADS = 2
#: Start of the frame that holds the sums and of the one that holds the table, and end of the table.
_SUMS_MAGIC, _SKIPPABLE_MAGIC, _SEEKABLE_MAGIC = 0x184D2A5D, 0x184D2A5E, 0x8F92EAB1
_HEADER, _ENTRY, _FOOTER = struct.Struct("<II"), struct.Struct("<II"), struct.Struct("<IBI")


class Table(NamedTuple):
    """Frames of a file.

    Attributes
    ----------
    starts : list of int
        Position of each frame, and the end of the last one.
    sizes : list of int
        Bytes of content of each frame.
    sums : bytes
        Sums of the frames; empty in files that contain none.
    """

    starts: list[int]
    sizes: list[int]
    sums: bytes


def compress(content: bytes, frame_bytes: int, sums: bytes) -> bytes:
    """Return the content in frames of ``frame_bytes`` each, the last one shorter, with their table.

    Parameters
    ----------
    content : bytes
    frame_bytes : int
    sums : bytes
        Sums of the frames, 4 bytes each.
    """
    view = memoryview(content)
    parts: list[bytes | bytearray | memoryview[int]] = [
        view[i : i + frame_bytes] for i in range(0, len(view), frame_bytes)
    ]
    compressor = zstandard.ZstdCompressor(level=LEVEL, write_content_size=True, write_checksum=True)
    compressed = compressor.multi_compress_to_buffer(parts, threads=min(_THREADS, len(parts)))
    frames = [compressed[i].tobytes() for i in range(len(parts))]
    table = b"".join(
        _ENTRY.pack(len(frame), len(part)) for frame, part in zip(frames, parts, strict=True)
    ) + _FOOTER.pack(len(frames), 0, _SEEKABLE_MAGIC)
    stated_sums = _HEADER.pack(_SUMS_MAGIC, len(sums)) + sums
    return b"".join([*frames, stated_sums, _HEADER.pack(_SKIPPABLE_MAGIC, len(table)), table])


def read_frames(
    file: BinaryIO, file_bytes: int, content_bytes: int, first: int, last: int, sums: bytes
) -> tuple[bytes, bool]:
    """Return the content of the frames ``first`` to ``last`` (exclusive).

    Parameters
    ----------
    file : binary file
        Result of ``compress`` from position 0.
    file_bytes, content_bytes : int
        Size of the file, and of the content that it must have.
    sums : bytes
        Sums of all frames, with which those in the file are compared.

    Returns
    -------
    content : bytes
    is_checked : bool
        True if the content agrees with its checksums; False for files of earlier versions, which have none.

    Raises
    ------
    CodecError
        If the file is damaged, or has other sums or another content size; at most ``content_bytes`` are
        decompressed.
    """
    table = _table(file, file_bytes, content_bytes)
    starts, sizes = table.starts, table.sizes
    if len(sizes) < last:
        raise CodecError(f"{len(sizes)} compressed frames: expected {last} or more")
    is_checked = bool(table.sums)
    if is_checked and table.sums[4 * first : 4 * last] != sums[4 * first : 4 * last]:
        raise CodecError(f"sums of the compressed frames {first} to {last - 1} differ from those expected")
    file.seek(starts[first])
    data = memoryview(file.read(starts[last] - starts[first]))
    decompressor = zstandard.ZstdDecompressor()
    parts = []
    for i in range(first, last):
        frame = data[starts[i] - starts[first] : starts[i + 1] - starts[first]]
        try:
            stated = zstandard.get_frame_parameters(frame)
            part = decompressor.decompress(frame) if stated.content_size == sizes[i] else b""
        except zstandard.ZstdError as error:
            raise CodecError(f"compressed frame {i}: {error}") from error
        if len(part) != sizes[i]:
            raise CodecError(
                f"compressed frame {i}: {stated.content_size} bytes of content, expected {sizes[i]}"
            )
        if is_checked and not stated.has_checksum:
            raise CodecError(f"compressed frame {i}: no checksum")
        parts.append(part)
    return b"".join(parts), is_checked


def _table(file: BinaryIO, file_bytes: int, content_bytes: int) -> Table:
    """Return the frames of a file; raises CodecError."""
    file.seek(max(file_bytes - _FOOTER.size, 0))
    footer = file.read(_FOOTER.size)
    if len(footer) != _FOOTER.size:
        raise CodecError(f"{file_bytes} bytes: too short for a table of compressed frames")
    count, descriptor, magic = _FOOTER.unpack(footer)
    table_bytes = _HEADER.size + count * _ENTRY.size + _FOOTER.size
    if magic != _SEEKABLE_MAGIC or descriptor or table_bytes > file_bytes:
        raise CodecError(f"no table of compressed frames at the end of {file_bytes} bytes")
    sums_bytes = _HEADER.size + 4 * count
    position = max(file_bytes - table_bytes - sums_bytes, 0)
    file.seek(position)
    end = file.read(file_bytes - position)
    starts, sizes = [0], []
    for compressed, size in _ENTRY.iter_unpack(end[_HEADER.size - table_bytes : -_FOOTER.size]):
        starts.append(starts[-1] + compressed)
        sizes.append(size)
    between = file_bytes - table_bytes - starts[-1]
    if between not in (0, sums_bytes) or sum(sizes) != content_bytes:
        raise CodecError(
            f"compressed frames of {starts[-1]} bytes with {sum(sizes)} bytes of content: expected "
            f"{file_bytes - table_bytes} bytes with {content_bytes}"
        )
    if between and end[: _HEADER.size] != _HEADER.pack(_SUMS_MAGIC, 4 * count):
        raise CodecError(f"no sums of {count} compressed frames after byte {starts[-1]}")
    return Table(starts, sizes, end[_HEADER.size : sums_bytes] if between else b"")
