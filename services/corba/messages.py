# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of GIOP 1.2 with their headers and fragments (§9.4)."""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable

from cdff_common.errors import CodecError
from services.corba.cdr import CdrReader, CdrWriter

_MAGIC, _VERSION = b"GIOP", (1, 2)
REQUEST, REPLY, _CANCEL, LOCATE_REQUEST, LOCATE_REPLY, CLOSE, ERROR, _FRAGMENT = range(8)
HEADER = struct.Struct("<4sBBBBI")

#: Returns the next bytes of a connection; raises EOFError at its end.
Receive = Callable[[int], bytes]


def receive_bytes(sock: socket.socket, size: int) -> bytes:
    """Return the next bytes of a connection; raises EOFError at its end."""
    data = bytearray(size)
    view, position = memoryview(data), 0
    while position < size:
        count = sock.recv_into(view[position:])
        if not count:
            raise EOFError("the connection is closed")
        position += count
    return bytes(data)


def read_message(receive: Receive, max_bytes: int) -> tuple[bytes, int, bool]:
    """Return a message with its header and its fragments, its kind, and whether it is little-endian.

    Raises
    ------
    CodecError
        If the bytes are not a message, or it is larger than ``max_bytes``.
    EOFError
        At the end of the connection.
    """
    data, kind, flags = _part(receive, max_bytes)
    message, has_more = bytearray(data), bool(flags & 2)
    while has_more:
        part, part_kind, part_flags = _part(receive, max_bytes)
        if part_kind != _FRAGMENT or len(message) + len(part) > max_bytes:
            raise CodecError(f"GIOP message of kind {part_kind}: expected a fragment of a message")
        message += part[HEADER.size + 4 :]
        has_more = bool(part_flags & 2)
    return bytes(message), kind, bool(flags & 1)


def _part(receive: Receive, max_bytes: int) -> tuple[bytes, int, int]:
    """Return one message with its header, its kind and its flags."""
    header = receive(HEADER.size)
    magic, major, minor, flags, kind, _ = HEADER.unpack(header)
    (size,) = struct.unpack("<I" if flags & 1 else ">I", header[8:])
    if magic != _MAGIC or (major, minor) > _VERSION or major != 1:
        raise CodecError(f"{header!r}: expected the header of GIOP 1.0 to 1.2")
    if size > max_bytes:
        raise CodecError(f"GIOP message of {size} bytes: expected at most {max_bytes}")
    return header + receive(size), kind, flags


def skip_contexts(reader: CdrReader) -> None:
    """Move behind the service contexts, to the body of a message."""
    for _ in range(reader.count(8)):
        reader.number("ulong")
        reader.octets()
    if reader.remaining > 0:
        reader.align(8)


def finish_message(writer: CdrWriter, kind: int) -> bytes:
    """Return a message from its header, whose bytes are free, and its content."""
    size = len(writer.data) - HEADER.size
    writer.data[: HEADER.size] = HEADER.pack(_MAGIC, *_VERSION, 1, kind, size)
    return bytes(writer.data)
