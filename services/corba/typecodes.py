# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Type codes of CORBA, and the values of an ``any``, which states its type (§9.3.5 and §9.3.6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import CodecError
from services.corba.cdr import CdrReader, CdrWriter

_NULL, _VOID, _STRING, _STRUCT, _ENUM, _SEQUENCE, _ARRAY, _ALIAS, _EXCEPTION = (
    0,
    1,
    18,
    15,
    17,
    19,
    20,
    21,
    22,
)
_INDIRECTION = 0xFFFFFFFF
#: Primitive kinds by their number.
_PRIMITIVES = {
    2: "short",
    3: "long",
    4: "ushort",
    5: "ulong",
    6: "float",
    7: "double",
    8: "boolean",
    9: "char",
    10: "octet",
    23: "longlong",
    24: "ulonglong",
}
_NUMBERS = {name: number for number, name in _PRIMITIVES.items()}
_DTYPES = {
    "short": "i2",
    "long": "i4",
    "ushort": "u2",
    "ulong": "u4",
    "float": "f4",
    "double": "f8",
    "boolean": "u1",
    "char": "u1",
    "octet": "u1",
    "longlong": "i8",
    "ulonglong": "u8",
}
#: Deepest nesting of a type.
_MAX_DEPTH = 32
#: Largest number of members of a type, and of numbers in a value without its sequences.
_MAX_MEMBERS, _MAX_LEAVES = 4096, 1 << 20


@dataclass(frozen=True)
class TypeCode:
    """A type.

    Attributes
    ----------
    kind : str
        Primitive kind, or ``string struct enum sequence array null``.
    name : str
        Name of a struct or an enumeration.
    id : str
        Its repository id.
    members : tuple of (str, TypeCode)
        Members of a struct.
    labels : tuple of str
        Enumerators.
    element : TypeCode or None
        Type of the elements of a sequence or an array.
    length : int
        Length of an array.
    """

    kind: str
    name: str = ""
    id: str = ""
    members: tuple[tuple[str, TypeCode], ...] = ()
    labels: tuple[str, ...] = ()
    element: TypeCode | None = None
    length: int = 0

    @cached_property
    def leaves(self) -> int:
        """Number of numbers, texts and sequences in a value, at least 1."""
        if self.kind == "array" and self.element is not None:
            return max(self.length, 1) * self.element.leaves
        return max(sum(kind.leaves for _, kind in self.members), 1)

    @cached_property
    def block(self) -> tuple[str, Any] | None:
        """Kind and type in numpy of a value that is numbers of one kind without gaps; else None."""
        if self.kind in _DTYPES:
            return self.kind, _DTYPES[self.kind]
        if self.kind == "array":
            inner = self.element.block if self.element is not None else None
            return inner and (inner[0], (inner[1], (self.length,)))
        if self.kind == "struct" and self.members:
            parts = [(name, kind.block) for name, kind in self.members]
            kinds = {block[0] if block else None for _, block in parts}
            names = {name for name, _ in parts}
            if len(kinds) == 1 and None not in kinds and len(names) == len(parts):
                return next(iter(kinds)) or "", [(name, block[1]) for name, block in parts if block]
        return None


def read_type(reader: CdrReader) -> TypeCode:
    """Return a type code; raises CodecError if it is malformed or of a kind that robots do not send."""
    return _read_type(reader, {}, 0)


def _read_type(reader: CdrReader, known: dict[int, TypeCode], depth: int) -> TypeCode:
    if depth > _MAX_DEPTH:
        raise CodecError(f"type code with a nesting of more than {_MAX_DEPTH}")
    reader.align(4)
    start = reader.position
    kind = reader.number("ulong")
    if kind == _INDIRECTION:
        at = reader.position
        target = at + int(reader.number("long"))
        if target not in known:
            raise CodecError(f"type code refers to byte {target}, where no complete type begins")
        return known[target]
    if kind in _PRIMITIVES:
        found = TypeCode(_PRIMITIVES[kind])
    elif kind in (_NULL, _VOID):
        found = TypeCode("null")
    elif kind == _STRING:
        reader.number("ulong")
        found = TypeCode("string")
    elif kind in (_STRUCT, _EXCEPTION, _ENUM, _SEQUENCE, _ARRAY, _ALIAS):
        found = _read_complex(kind, reader.encapsulation(), known, depth)
    else:
        raise CodecError(
            f"type code of kind {kind}: expected numbers, strings, structs, enums, sequences or arrays"
        )
    known[start] = found
    return found


def _read_complex(kind: int, inner: CdrReader, known: dict[int, TypeCode], depth: int) -> TypeCode:
    if kind in (_SEQUENCE, _ARRAY):
        element = _read_type(inner, known, depth + 1)
        length = inner.number("ulong")
        found = TypeCode("sequence" if kind == _SEQUENCE else "array", element=element, length=length)
        return _limited(found)
    repository_id, name = inner.text(), inner.text()
    if kind == _ALIAS:
        return _read_type(inner, known, depth + 1)
    count = inner.number("ulong")
    if count > _MAX_MEMBERS:
        raise CodecError(f"type {name[:80]} with {count} members: expected at most {_MAX_MEMBERS}")
    if kind == _ENUM:
        return TypeCode("enum", name, repository_id, labels=tuple(inner.text() for _ in range(count)))
    members = tuple((inner.text(), _read_type(inner, known, depth + 1)) for _ in range(count))
    return _limited(TypeCode("struct", name, repository_id, members))


def _limited(kind: TypeCode) -> TypeCode:
    """Return a type; raises CodecError if its values are larger than those of robots."""
    if kind.leaves > _MAX_LEAVES:
        raise CodecError(
            f"type {kind.name[:80] or kind.kind} with {kind.leaves} parts: expected at most {_MAX_LEAVES}"
        )
    return kind


def write_type(writer: CdrWriter, kind: TypeCode) -> None:
    """Add a type code."""
    if kind.kind in _NUMBERS:
        writer.number("ulong", _NUMBERS[kind.kind])
    elif kind.kind == "string":
        writer.number("ulong", _STRING)
        writer.number("ulong", 0)
    elif kind.kind == "null":
        writer.number("ulong", _NULL)
    else:
        number = {"struct": _STRUCT, "enum": _ENUM, "sequence": _SEQUENCE, "array": _ARRAY}[kind.kind]
        writer.number("ulong", number)
        body = CdrWriter(b"\1")
        if kind.element is not None:
            write_type(body, kind.element)
            body.number("ulong", kind.length)
        else:
            body.text(kind.id)
            body.text(kind.name)
            body.number("ulong", len(kind.members) or len(kind.labels))
            for label in kind.labels:
                body.text(label)
            for name, member in kind.members:
                body.text(name)
                write_type(body, member)
        writer.encapsulation(body)


class AnyReader:
    """Reader of ``any``; it keeps the types of earlier values."""

    def __init__(self) -> None:
        self._known: dict[bytes, TypeCode] = {}

    def read(self, reader: CdrReader) -> tuple[TypeCode, Any]:
        """Return type and value; a struct is a dictionary or, in an array, a row of a structured array.

        Raises
        ------
        CodecError
            If type or value are malformed.
        """
        reader.align(4)
        start = reader.position
        if reader.number("ulong") in (_STRUCT, _SEQUENCE, _ARRAY, _ENUM, _ALIAS):
            end = reader.count() + reader.position
            key = bytes(reader.data[start:end]) + bytes([reader.is_little])
            kind = self._known.get(key)
            if kind is None:
                reader.position = start
                kind = read_type(reader)
                if len(self._known) >= _MAX_MEMBERS:
                    self._known.clear()
                self._known[key] = kind
            reader.position = end
        else:
            reader.position = start
            kind = read_type(reader)
        return kind, read_value(reader, kind)


def read_value(reader: CdrReader, kind: TypeCode) -> Any:
    """Return a value of a type; raises CodecError if the bytes are not one."""
    match kind.kind:
        case "struct":
            return {name: read_value(reader, member) for name, member in kind.members}
        case "string":
            return reader.text()
        case "enum":
            number = reader.number("ulong")
            if number >= len(kind.labels):
                raise CodecError(f"value {number} of {kind.name}: expected less than {len(kind.labels)}")
            return kind.labels[number]
        case "sequence":
            assert kind.element is not None
            return _read_elements(reader, kind.element, reader.count(_least_bytes(kind.element)))
        case "array":
            assert kind.element is not None
            return _read_elements(reader, kind.element, kind.length)
        case "null":
            return None
        case "boolean":
            return bool(reader.number("boolean"))
        case _:
            return reader.number(kind.kind)


def _least_bytes(kind: TypeCode) -> int:
    """Return a lower bound of the bytes of a value, at least 1."""
    if kind.block is not None:
        return max(int(np.dtype(kind.block[1]).itemsize), 1)
    return 4 if kind.kind in ("string", "sequence", "enum") else 1


def _read_elements(reader: CdrReader, element: TypeCode, count: int) -> Any:
    """Return numbers and compounds of them as an array, other elements as a list."""
    if element.block is None:
        if count > reader.remaining:
            raise CodecError(f"array of {count} elements with {reader.remaining} bytes left")
        return [read_value(reader, element) for _ in range(count)]
    name, layout = element.block
    dtype = np.dtype(layout).newbyteorder("<" if reader.is_little else ">")
    if not count:
        return np.zeros(0, dtype)
    if dtype.subdtype is not None:  # an array of arrays
        base, shape = dtype.subdtype
        reader.align(np.dtype(_DTYPES[name]).itemsize)
        data = reader.take(count * dtype.itemsize)
        return np.frombuffer(data, base).reshape(count, *shape)
    reader.align(np.dtype(_DTYPES[name]).itemsize)
    return np.frombuffer(reader.take(count * dtype.itemsize), dtype)


def write_any(writer: CdrWriter, kind: TypeCode, value: Any) -> None:
    """Add type and value; raises CodecError if the value is not of the type."""
    write_type(writer, kind)
    write_value(writer, kind, value)


def write_value(writer: CdrWriter, kind: TypeCode, value: Any) -> None:
    """Add a value without its type; raises CodecError if it is not of the type."""
    match kind.kind:
        case "struct":
            if not isinstance(value, Mapping) or set(value) != {name for name, _ in kind.members}:
                raise CodecError(
                    f"{value!r:.80} as {kind.name}: expected {[name for name, _ in kind.members]}"
                )
            for name, member in kind.members:
                write_value(writer, member, value[name])
        case "string":
            if not isinstance(value, str):
                raise CodecError(f"a {type(value).__name__} as string: expected a text")
            writer.text(value)
        case "enum":
            if value not in kind.labels:
                raise CodecError(f"{value!r:.80} as {kind.name}: expected one of {', '.join(kind.labels)}")
            writer.number("ulong", kind.labels.index(value))
        case "sequence" | "array":
            _write_elements(writer, kind, value)
        case "null":
            return
        case _:
            writer.number(kind.kind, value)


def _write_elements(writer: CdrWriter, kind: TypeCode, values: Any) -> None:
    """Add a list or an array; a structured array of equal fields is added as a whole."""
    assert kind.element is not None
    if not isinstance(values, list | tuple | bytes | np.ndarray):
        raise CodecError(f"a {type(values).__name__} as {kind.kind}: expected a list or an array")
    if kind.kind == "sequence":
        writer.number("ulong", len(values))
    elif len(values) != kind.length:
        raise CodecError(f"{len(values)} elements: expected {kind.length}")
    block = kind.element.block
    if block is not None and len(values):
        name, layout = block
        dtype = np.dtype(layout).newbyteorder("<")
        is_whole = isinstance(values, np.ndarray) and values.dtype.newbyteorder("<") == dtype
        if kind.element.kind in _DTYPES or is_whole:
            writer.align(np.dtype(_DTYPES[name]).itemsize)
            writer.data += _elements(values, dtype).tobytes()
            return
    for value in values:
        write_value(writer, kind.element, value)


def _elements(values: Any, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return numbers, or compounds of them, as an array (n,); raises CodecError if they are not."""
    try:
        array = np.ascontiguousarray(list(values) if isinstance(values, bytes) else values, dtype)
    except (TypeError, ValueError, OverflowError) as error:
        raise CodecError(f"elements as {dtype}: {error}") from error
    if array.ndim != 1:
        raise CodecError(f"elements of the shape {array.shape}: expected one dimension")
    return array
