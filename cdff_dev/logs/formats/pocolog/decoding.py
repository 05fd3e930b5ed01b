# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Decoding of samples that were written by Typelib.

A sample is the memory of the C++ object with its padding, in which the elements of each container, after
their number as 64 bits, replace the object of the container. Padding at the end of a sample can be absent.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from cdff_common.errors import CodecError


class Cursor:
    """Position in the bytes of a sample of the byte order ``<`` or ``>``."""

    def __init__(self, data: bytes | memoryview, order: str) -> None:
        self._data = memoryview(data)
        self._order = "big" if order == ">" else "little"
        self._at = 0

    @property
    def remaining(self) -> int:
        """Number of bytes after the position."""
        return len(self._data) - self._at

    def take(self, count: int, name: str) -> memoryview:
        """Return the next bytes; raises CodecError if the sample has fewer."""
        if count > self.remaining:
            raise CodecError(f"{name}: {self.remaining} bytes at byte {self._at}, expected {count}")
        self._at += count
        return self._data[self._at - count : self._at]

    def take_count(self, element_bytes: int, name: str) -> int:
        """Return the number of elements of a container; raises CodecError if they exceed the sample."""
        at = self._at
        count = int.from_bytes(self.take(8, name), self._order)  # type: ignore[arg-type]
        if count * element_bytes > self.remaining:
            raise CodecError(
                f"{name}: {count} elements at byte {at}, expected at most {self.remaining // element_bytes}"
            )
        return count


class Type(Protocol):
    """A type of samples or of parts of them."""

    @property
    def name(self) -> str:
        """Name in the log."""

    @property
    def size(self) -> int:
        """Size of the C++ object, bytes; 0 if the file does not state it."""

    @property
    def min_bytes(self) -> int:
        """Smallest number of bytes of an encoded value, at least 1."""

    @property
    def padding(self) -> int:
        """Number of bytes at the end of an encoded value that can be absent at the end of a sample."""

    def decode(self, cursor: Cursor) -> Any:
        """Return the value at the position of the cursor."""


@dataclass(frozen=True, slots=True)
class Fixed:
    """Numbers, and compounds and arrays of them; a value is a number, a structured scalar or an array."""

    name: str
    dtype: np.dtype[Any]
    padding: int = 0

    @property
    def size(self) -> int:
        """Size of the object, bytes."""
        return self.dtype.itemsize

    @property
    def min_bytes(self) -> int:
        """Number of bytes."""
        return self.dtype.itemsize

    def decode(self, cursor: Cursor) -> Any:
        """Return the value at the position of the cursor."""
        return np.frombuffer(cursor.take(self.dtype.itemsize, self.name), self.dtype)[0]


@dataclass(frozen=True, slots=True)
class Enumeration(Fixed):
    """An enumeration; a value is its symbol, or its number as text if it has none."""

    symbols: Mapping[int, str] | None = None

    def decode(self, cursor: Cursor) -> str:
        """Return the value at the position of the cursor."""
        number = int(Fixed.decode(self, cursor))
        return (self.symbols or {}).get(number, str(number))


@dataclass(frozen=True, slots=True)
class Text:
    """``std::string``."""

    name: str
    size: int
    min_bytes: int = 8
    padding: int = 0

    def decode(self, cursor: Cursor) -> str:
        """Return the text at the position of the cursor."""
        return bytes(cursor.take(cursor.take_count(1, self.name), self.name)).decode("utf-8", "replace")


@dataclass(frozen=True, slots=True)
class Vector:
    """``std::vector``; a value is an array if its elements have a fixed size, else a list."""

    name: str
    size: int
    element: Type
    min_bytes: int = 8
    padding: int = 0

    def decode(self, cursor: Cursor) -> Any:
        """Return the elements at the position of the cursor."""
        count = cursor.take_count(self.element.min_bytes, self.name)
        return _elements(self.element, count, cursor, self.name)


@dataclass(frozen=True, slots=True)
class FixedArray:
    """Array of a constant number of containers, or of compounds with containers."""

    name: str
    size: int
    element: Type
    count: int
    min_bytes: int
    padding: int = 0

    def decode(self, cursor: Cursor) -> Any:
        """Return the elements at the position of the cursor."""
        if self.min_bytes > cursor.remaining:
            raise CodecError(f"{self.name}: {cursor.remaining} bytes, expected {self.min_bytes} or more")
        return _elements(self.element, self.count, cursor, self.name)


def _elements(element: Type, count: int, cursor: Cursor, name: str) -> Any:
    if isinstance(element, Fixed):
        data = cursor.take(count * element.dtype.itemsize, name)
        return np.frombuffer(data, element.dtype) if count else np.zeros(0, element.dtype)
    return [element.decode(cursor) for _ in range(count)]


@dataclass(frozen=True, slots=True)
class Compound:
    """Compound with containers; a value is a dictionary.

    Attributes
    ----------
    members : tuple
        Number of bytes of padding before each field, name and type of the field.
    tail : int
        Number of bytes of padding after the last field.
    """

    name: str
    size: int
    members: tuple[tuple[int, str, Type], ...]
    tail: int
    min_bytes: int
    padding: int

    def values(self, cursor: Cursor) -> Iterator[tuple[str, Any]]:
        """Yield names and values of the fields in order."""
        for gap, name, kind in self.members:
            if gap:
                cursor.take(gap, self.name)
            yield name, kind.decode(cursor)
        cursor.take(self.tail, self.name)

    def decode(self, cursor: Cursor) -> dict[str, Any]:
        """Return the fields by name."""
        return dict(self.values(cursor))


def field_names(kind: Type) -> tuple[str, ...]:
    """Return the names of the fields of a compound; none for other types."""
    if isinstance(kind, Compound):
        return tuple(name for _, name, _ in kind.members)
    return (kind.dtype.names or ()) if isinstance(kind, Fixed) else ()


def decode_sample(kind: Type, data: bytes | memoryview, order: str) -> Any:
    """Return the value of a sample; raises CodecError if the bytes are not those of the type."""
    padded = bytes(data) + bytes(kind.padding) if kind.padding else data
    cursor = Cursor(padded, order)
    value = kind.decode(cursor)
    if cursor.remaining > kind.padding:
        raise CodecError(f"{kind.name}: sample of {len(data)} bytes, expected {cursor.remaining} fewer")
    return value


def decode_field(kind: Type, name: str, data: bytes | memoryview, order: str) -> Any:
    """Return a field of a sample, without decoding those after it."""
    if isinstance(kind, Compound):
        return next(value for field, value in kind.values(Cursor(data, order)) if field == name)
    return decode_sample(kind, data, order)[name]
