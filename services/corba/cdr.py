# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common Data Representation of CORBA: numbers aligned to their size, in either byte order (§9.3)."""

from __future__ import annotations

import struct
from typing import Any

from cdff_common.errors import CodecError

#: Format and size of the primitive kinds.
_FORMATS = {
    "octet": ("B", 1),
    "boolean": ("B", 1),
    "char": ("B", 1),
    "short": ("h", 2),
    "ushort": ("H", 2),
    "long": ("i", 4),
    "ulong": ("I", 4),
    "longlong": ("q", 8),
    "ulonglong": ("Q", 8),
    "float": ("f", 4),
    "double": ("d", 8),
}
_STRUCTS = {
    (name, order): struct.Struct(("<" if order else ">") + code)
    for name, (code, _) in _FORMATS.items()
    for order in (False, True)
}


class CdrReader:
    """Position in the bytes of a message.

    Parameters
    ----------
    data : bytes-like
    is_little : bool
        Byte order.
    position : int
        First byte to read.
    origin : int
        Byte from which alignment counts.
    """

    __slots__ = ("data", "is_little", "origin", "position")

    def __init__(self, data: bytes | memoryview, is_little: bool, position: int = 0, origin: int = 0) -> None:
        self.data, self.is_little = memoryview(data), is_little
        self.position, self.origin = position, origin

    @property
    def remaining(self) -> int:
        """Number of bytes after the position."""
        return len(self.data) - self.position

    def align(self, size: int) -> None:
        """Move to the next multiple of a size."""
        self.position += -(self.position - self.origin) % size

    def take(self, count: int) -> memoryview:
        """Return the next bytes; raises CodecError if there are fewer."""
        if count > self.remaining:
            raise CodecError(
                f"CDR of {len(self.data)} bytes: {count} bytes at byte {self.position}, "
                f"expected at most {max(self.remaining, 0)}"
            )
        self.position += count
        return self.data[self.position - count : self.position]

    def number(self, kind: str) -> Any:
        """Return a number of a primitive kind such as ``ulong``."""
        form = _STRUCTS[kind, self.is_little]
        self.align(form.size)
        return form.unpack(self.take(form.size))[0]

    def count(self, element_bytes: int = 1) -> int:
        """Return the number of elements of a sequence; raises CodecError if they exceed the message."""
        count: int = self.number("ulong")
        if count * element_bytes > self.remaining:
            raise CodecError(f"CDR: sequence of {count} elements with {self.remaining} bytes left")
        return count

    def octets(self) -> bytes:
        """Return a sequence of octets."""
        return bytes(self.take(self.count()))

    def text(self) -> str:
        """Return a string; raises CodecError if it does not end with zero."""
        data = self.octets()
        if not data or data[-1] != 0:
            raise CodecError(f"CDR: string of {len(data)} bytes without its end")
        return data[:-1].decode("utf-8", "replace")

    def encapsulation(self) -> CdrReader:
        """Return a reader of an encapsulation, and move behind it."""
        size = self.count()
        if not size:
            raise CodecError("CDR: encapsulation without a byte order")
        start = self.position
        self.take(size)
        reader = CdrReader(self.data[: start + size], bool(self.data[start] & 1), start, start)
        reader.position += 1
        return reader


class CdrWriter:
    """Bytes of a message in little-endian order.

    Parameters
    ----------
    data : bytes
        First bytes, such as a message header, to which alignment counts.
    """

    def __init__(self, data: bytes = b"") -> None:
        self.data = bytearray(data)

    def align(self, size: int) -> None:
        """Add zeros up to the next multiple of a size."""
        self.data += bytes(-len(self.data) % size)

    def number(self, kind: str, value: float) -> None:
        """Add a number of a primitive kind; raises CodecError if it is out of range."""
        form = _STRUCTS[kind, True]
        self.align(form.size)
        try:
            self.data += form.pack(value)
        except struct.error as error:
            raise CodecError(f"{value!r} as {kind}: {error}") from error

    def octets(self, data: bytes) -> None:
        """Add a sequence of octets."""
        self.number("ulong", len(data))
        self.data += data

    def text(self, text: str) -> None:
        """Add a string."""
        self.octets(text.encode() + b"\0")

    def encapsulation(self, body: CdrWriter) -> None:
        """Add an encapsulation, whose first byte is its byte order."""
        self.octets(bytes(body.data))
