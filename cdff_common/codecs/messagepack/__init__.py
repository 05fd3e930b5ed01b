# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MessagePack of the dict form: one map per message; long lists of numbers are processed by compiled
loops.
"""

from __future__ import annotations

from typing import Any

import msgpack

from cdff_common.codecs.dict_form import from_dict_form
from cdff_common.codecs.warm import has_numba
from cdff_common.codecs.wire_types import message_node, wire_node
from cdff_common.errors import CodecError

__all__ = ["decode", "encode", "unpack", "unpack_message"]

#: Messages below this size are unpacked without the schema.
_GUIDED_FROM_BYTES = 4096


def encode(value: Any, type_name: str | None = None) -> bytes:
    """Encode ``to_dict_form(value)``; size variants have the same encoding."""
    from cdff_common.codecs.messagepack.lists import pieces

    return b"".join(pieces(value, wire_node(value, type_name)))


def decode(type_name: str, data: bytes) -> Any:
    """Decode a message; also reads samples of InFuse logs.

    Raises
    ------
    CodecError
        If the bytes are not MessagePack, or not of that type.
    """
    name = message_node(type_name).name
    try:
        return from_dict_form(name, unpack_message(data, name))
    except CodecError as error:
        raise CodecError(f"{name} as msgpack, {len(data)} bytes: {error}") from error


def unpack_message(data: bytes, type_name: str) -> Any:
    """Return the input of ``from_dict_form``, as ``unpack`` but with long lists of numbers as arrays."""
    if len(data) < _GUIDED_FROM_BYTES or not has_numba():
        return unpack(data)
    from cdff_common.codecs.messagepack.reading import guided

    return guided(bytes(data), message_node(type_name))


def unpack(data: bytes) -> Any:
    """Unpack MessagePack bytes; lengths beyond the input are refused before any allocation."""
    size = len(data)
    try:
        return msgpack.unpackb(
            data,
            raw=False,
            strict_map_key=True,
            unicode_errors="surrogateescape",
            max_str_len=size,
            max_bin_len=size,
            max_array_len=size,
            max_map_len=size,
            max_ext_len=size,
        )
    except (ValueError, msgpack.UnpackException, msgpack.ExtraData, RecursionError, TypeError) as error:
        raise CodecError(f"not MessagePack: {type(error).__name__} {error}") from error
