# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writing of long lists of numbers and long byte strings as blocks.

The output equals that of any MessagePack library for nested lists of float64.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.dict_form import dict_form_of
from cdff_common.types.schema import Alias, Array, Node, OctetString, Real, Struct

#: Arrays of at least this many numbers are written as a block.
_LONG = 128
#: Byte strings of at least this size are passed on without a copy.
_LONG_BYTES = 4096
_FLOAT64 = 0xCB
_BIN16, _BIN32 = b"\xc5", b"\xc6"


def pieces(value: Any, node: Node | Alias) -> Iterator[bytes | memoryview]:
    """Yield the MessagePack of the value of a node in pieces; some are views of its arrays."""
    packer = msgpack.Packer(unicode_errors="surrogateescape")
    if not _has_long(value, node):
        yield packer.pack(dict_form_of(value, node))
        return
    match node:
        case Struct():
            yield packer.pack_map_header(len(node.fields))
            for field in node.fields:
                yield packer.pack(field.key)
                yield from pieces(getattr(value, field.attribute), field.node)
        case Alias():
            yield from pieces(getattr(value, node.attribute), node.node)
        case OctetString():
            yield _bin_header(value.nbytes)
            yield value.reshape(-1).view(np.uint8).data
        case _:
            yield packer.pack_array_header(len(value))
            yield _block(value).data.cast("B")


def _has_long(value: Any, node: Node | Alias) -> bool:
    """Return whether a message has a long byte string or a long array of REALs, outside lists of messages."""
    match node:
        case Array(element=Real()):
            return bool(
                value.size >= _LONG and (value.ndim == 1 or (value.ndim == 2 and value.shape[1] < 16))
            )
        case OctetString():
            return bool(value.nbytes >= _LONG_BYTES)
        case Struct():
            return any(_has_long(getattr(value, f.attribute), f.node) for f in node.fields)
        case Alias():
            return _has_long(getattr(value, node.attribute), node.node)
        case _:
            return False


def _bin_header(size: int) -> bytes:
    return _BIN16 + size.to_bytes(2, "big") if size < 1 << 16 else _BIN32 + size.to_bytes(4, "big")


def _block(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the bytes of the elements of a list: each a number, or a list of less than 16 numbers."""
    rows = len(values)
    big = values.astype(">f8").view(np.uint8).reshape(rows, -1, 8)
    columns = big.shape[1]
    head = values.ndim - 1
    block = np.empty((rows, head + 9 * columns), dtype=np.uint8)
    if head:
        block[:, 0] = 0x90 | columns
    for k in range(columns):
        block[:, head + 9 * k] = _FLOAT64
        block[:, head + 9 * k + 1 : head + 9 * k + 9] = big[:, k]
    return block
