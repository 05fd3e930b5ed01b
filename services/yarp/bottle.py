# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values of YARP in binary and as text (https://yarp.it/latest/data_rep.html).

A list is a Python list, a vocabulary a ``Vocab``, a blob ``bytes``; numbers of one type are an array.
"""

from __future__ import annotations

import re
import struct
from typing import Any

import numpy as np

from cdff_common.errors import CodecError

_INT32, _STRING, _VOCAB, _FLOAT64, _BLOB, _INT64, _LIST = 1, 4, 9, 10, 12, 17, 256
_INT8, _INT16, _FLOAT32 = 32, 64, 11
#: Tags of numbers and their types in numpy.
_NUMBERS = {_INT8: "<i1", _INT16: "<i2", _INT32: "<i4", _INT64: "<i8", _FLOAT32: "<f4", _FLOAT64: "<f8"}
_MAX_DEPTH = 32
_WORD = struct.Struct("<i")
_TOKEN = re.compile(
    r"\s*(?:(?P<open>\()|(?P<close>\))|\[(?P<vocab>[^\]]{0,4})\]|\{(?P<blob>[^}]*)\}"
    r'|"(?P<text>(?:[^"\\]|\\.)*)"|(?P<word>[^\s()\[\]{}"]+))'
)


class Vocab(str):
    """A short identifier of up to four characters."""

    __slots__ = ()

    @property
    def number(self) -> int:
        """The characters as a number of 32 bits."""
        return int.from_bytes(self.encode("latin-1")[:4].ljust(4, b"\0"), "little", signed=True)

    @classmethod
    def of_number(cls, number: int) -> Vocab:
        """Return the identifier of a number."""
        return cls(number.to_bytes(4, "little", signed=True).rstrip(b"\0").decode("latin-1"))


class _Cursor:
    def __init__(self, data: memoryview) -> None:
        self.data, self.position = data, 0

    def take(self, count: int) -> memoryview:
        if not 0 <= count <= len(self.data) - self.position:
            raise CodecError(
                f"bottle of {len(self.data)} bytes: {count} bytes at byte {self.position}, expected at most "
                f"{len(self.data) - self.position}"
            )
        self.position += count
        return self.data[self.position - count : self.position]

    def word(self) -> int:
        number: int = _WORD.unpack(self.take(4))[0]
        return number


def decode_bottle(data: bytes | memoryview) -> Any:
    """Return the list in binary: an array if it has numbers of one type.

    Raises
    ------
    CodecError
        If the bytes are not a list.
    """
    cursor = _Cursor(memoryview(data))
    tag = cursor.word()
    if tag & _LIST == 0:
        raise CodecError(f"bottle with the tag {tag}: expected a list")
    value = _list(cursor, tag, 0)
    if cursor.position != len(cursor.data):
        raise CodecError(f"bottle of {len(cursor.data)} bytes: {cursor.position} expected")
    return value


def _list(cursor: _Cursor, tag: int, depth: int) -> Any:
    if depth > _MAX_DEPTH:
        raise CodecError(f"bottle with a nesting of more than {_MAX_DEPTH}")
    count, element = cursor.word(), tag & ~_LIST
    if count < 0:
        raise CodecError(f"bottle with {count} elements")
    if element in _NUMBERS:
        dtype = np.dtype(_NUMBERS[element])
        return np.frombuffer(cursor.take(count * dtype.itemsize), dtype)
    if 4 * count > len(cursor.data) - cursor.position:
        raise CodecError(f"bottle with {count} elements: expected fewer")
    return [_value(cursor, element or cursor.word(), depth) for _ in range(count)]


def _value(cursor: _Cursor, tag: int, depth: int) -> Any:
    if tag & _LIST:
        return _list(cursor, tag, depth + 1)
    if tag in _NUMBERS:
        dtype = np.dtype(_NUMBERS[tag])
        return np.frombuffer(cursor.take(dtype.itemsize), dtype)[0].item()
    if tag == _STRING:
        return bytes(cursor.take(cursor.word())).removesuffix(b"\0").decode("utf-8", "replace")
    if tag == _VOCAB:
        return Vocab.of_number(cursor.word())
    if tag == _BLOB:
        return bytes(cursor.take(cursor.word()))
    raise CodecError(
        f"bottle with the tag {tag}: expected one of numbers, strings, vocabularies, blobs or lists"
    )


def encode_bottle(values: Any) -> bytes:
    """Return a list or an array in binary; raises CodecError if a value has no counterpart."""
    parts: list[bytes] = []
    _write_list(parts, values)
    return b"".join(parts)


def _write_list(parts: list[bytes], values: Any) -> None:
    if isinstance(values, np.ndarray):
        tag = next((tag for tag, kind in _NUMBERS.items() if np.dtype(kind) == values.dtype), None)
        if tag is None or values.ndim != 1:
            raise CodecError(
                f"array of {values.dtype}, {values.ndim} dimensions, in a bottle: expected a vector"
            )
        parts += [_WORD.pack(_LIST + tag), _WORD.pack(len(values)), values.tobytes()]
        return
    tags = [_tag(value) for value in values]
    common = tags[0] if tags and len(set(tags)) == 1 and tags[0] != _LIST else 0
    parts += [_WORD.pack(_LIST + common), _WORD.pack(len(tags))]
    for tag, value in zip(tags, values, strict=True):
        if tag == _LIST:
            _write_list(parts, value)  # its tag states the type of its elements
            continue
        if not common:
            parts.append(_WORD.pack(tag))
        parts.append(_bytes(tag, value))


def _tag(value: Any) -> int:
    match value:
        case Vocab():
            return _VOCAB
        case str():
            return _STRING
        case bytes():
            return _BLOB
        case list() | tuple() | np.ndarray():
            return _LIST
        case bool() | int() | np.integer():
            return _INT32 if -(1 << 31) <= int(value) < 1 << 31 else _INT64
        case float() | np.floating():
            return _FLOAT64
        case _:
            raise CodecError(
                f"a {type(value).__name__} in a bottle: expected a number, a text, bytes or a list"
            )


def _bytes(tag: int, value: Any) -> bytes:
    if tag == _STRING:
        text: bytes = value.encode()
        return _WORD.pack(len(text)) + text
    if tag == _BLOB:
        return _WORD.pack(len(value)) + bytes(value)
    if tag == _VOCAB:
        return _WORD.pack(value.number)
    return np.array(value, _NUMBERS[tag]).tobytes()


def parse_text(line: str) -> list[Any]:
    """Return the list in a line of text; raises CodecError if it is malformed."""
    stack: list[list[Any]] = [[]]
    position, line = 0, line.rstrip()
    while position < len(line):
        match = _TOKEN.match(line, position)
        if match is None:
            raise CodecError(f"bottle as text: {line[position : position + 20]!r} at character {position}")
        position = match.end()
        if match["open"]:
            if len(stack) > _MAX_DEPTH:
                raise CodecError(f"bottle with a nesting of more than {_MAX_DEPTH}")
            stack.append([])
        elif match["close"]:
            if len(stack) == 1:
                raise CodecError(f"bottle as text: ) without ( at character {position - 1}")
            inner = stack.pop()
            stack[-1].append(inner)
        else:
            stack[-1].append(_item(match))
    if len(stack) > 1:
        raise CodecError("bottle as text: ( without )")
    return stack[0]


def _item(match: re.Match[str]) -> Any:
    if match["vocab"] is not None:
        return Vocab(match["vocab"])
    if match["text"] is not None:
        return re.sub(r"\\(.)", lambda m: {"n": "\n", "t": "\t", "r": "\r"}.get(m[1], m[1]), match["text"])
    if match["blob"] is not None:
        try:
            return bytes(int(number) for number in match["blob"].split())
        except ValueError as error:
            raise CodecError(f"bottle as text: blob: {error}") from error
    return _number_or_word(match["word"])


def _number_or_word(word: str) -> int | float | str:
    """Return a word as a number if it is one."""
    try:
        return int(word, 0) if word.isascii() and "_" not in word else word
    except ValueError:
        pass
    try:
        return float(word)
    except ValueError:
        return word


def format_text(values: Any) -> str:
    """Return a list or an array as a line of text."""
    return " ".join(_text(value) for value in values)


def _text(value: Any) -> str:
    match value:
        case Vocab():
            return f"[{value}]"
        case str():
            if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", value) and _number_or_word(value) is value:
                return value
            escaped = (
                value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\r", "\\r")
            )
            return f'"{escaped}"'
        case bytes():
            return "{" + " ".join(map(str, value)) + "}"
        case list() | tuple() | np.ndarray():
            return f"({format_text(value)})"
        case float() | np.floating():
            return repr(float(value))
        case _:
            return str(int(value))
