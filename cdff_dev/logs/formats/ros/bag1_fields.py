# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Headers of the records of a ROS 1 bag: named fields."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, BinaryIO

LENGTH = struct.Struct("<L")
#: Length and name of the field with the type of a record, and the type of a chunk, as bytes; and largest
#: distance of that field from the start of its record.
_CHUNK_FIELD, _MAX_DISTANCE = b"\x04\x00\x00\x00op=\x05", 64
#: Size of the parts in which a file is searched.
_BLOCK_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Bag1Connection:
    """A topic of a bag, with the type of its messages as named by ROS 2 and its definition."""

    number: int
    topic: str
    type_name: str
    definition: bytes
    md5sum: str


def fields(header: bytes | memoryview) -> dict[bytes, bytes]:
    """Return the fields of a header by name; raises ValueError or struct.error if it is damaged."""
    data, at = bytes(header), 0
    values: dict[bytes, bytes] = {}
    while at < len(data):
        (size,) = LENGTH.unpack_from(data, at)
        at += LENGTH.size
        name, separator, value = data[at : at + size].partition(b"=")
        if at + size > len(data) or not separator:
            raise ValueError(f"a field of {size} bytes at byte {at} of a header of {len(data)}")
        values[name] = value
        at += size
    return values


def connection(values: dict[bytes, bytes], data: bytes | memoryview) -> Bag1Connection:
    """Return the connection of a record; raises KeyError, ValueError or struct.error if it is damaged."""
    described = fields(data)
    package, _, name = described[b"type"].decode().partition("/")
    topic = values[b"topic"].decode()
    return Bag1Connection(
        number=int.from_bytes(values[b"conn"], "little"),
        topic="/" * topic.startswith("/") + "/".join(part for part in topic.split("/") if part),
        type_name=f"{package}/msg/{name}",
        definition=described[b"message_definition"],
        md5sum=described[b"md5sum"].decode(),
    )


def text(value: bytes) -> str:
    """Return a field for a message."""
    return repr(value[:40].decode(errors="replace"))


def next_chunk(file: BinaryIO, at: int, size: int) -> int:
    """Return the offset of the first chunk at or after an offset, or the size of the file if there is
    none.
    """
    while at < size:
        file.seek(at)
        block = file.read(_BLOCK_BYTES)
        field_start = block.find(_CHUNK_FIELD)
        while field_start >= 0:
            for start in range(field_start - LENGTH.size, max(field_start - _MAX_DISTANCE, -1), -1):
                if _is_chunk(block[start : start + 2 * _MAX_DISTANCE]):
                    return at + start
            field_start = block.find(_CHUNK_FIELD, field_start + 1)
        if len(block) < _BLOCK_BYTES:
            break
        at += _BLOCK_BYTES - 2 * _MAX_DISTANCE
    return size


def _is_chunk(data: bytes) -> bool:
    """Return whether bytes begin with the header of a chunk."""
    try:
        (size,) = LENGTH.unpack_from(data)
        values: dict[bytes, Any] = fields(data[LENGTH.size : LENGTH.size + size])
    except (ValueError, struct.error):
        return False
    return size <= len(data) - LENGTH.size and {b"op", b"compression", b"size"} <= set(values)
