# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MessagePack of the plain form: one message, one map; long lists of numbers go through compiled loops."""

from __future__ import annotations

from typing import Any

import msgpack

from cdff_common.codecs.bridge import message_node
from cdff_common.codecs.plain import from_plain
from cdff_common.codecs.siblings import wire_node
from cdff_common.errors import CodecError

__all__ = ["decode", "encode", "unpack", "unpack_message"]

#: Messages below this size are unpacked in one go.
_GUIDED_FROM_OCTETS = 4096


def encode(value: Any, type_name: str | None = None) -> bytes:
    """MessagePack of ``to_plain(value)``; the same for siblings."""
    from cdff_common.codecs.messagepack.lists import pieces

    return b"".join(pieces(value, wire_node(value, type_name)))


def decode(type_name: str, data: bytes) -> Any:
    """Inverse of ``encode``; also reads samples of InFuse logs.

    Raises
    ------
    CodecError
        If the bytes are not MessagePack, or not of that type.
    """
    name = message_node(type_name).name
    try:
        return from_plain(name, unpack_message(data, name))
    except CodecError as error:
        raise CodecError(f"{name} as msgpack, {len(data)} octets: {error}") from error


def unpack_message(data: bytes, type_name: str) -> Any:
    """What ``from_plain`` takes of a message: as ``unpack`` gives it, with long lists of numbers as arrays."""
    if len(data) < _GUIDED_FROM_OCTETS:
        return unpack(data)
    from cdff_common.codecs.messagepack.reading import guided

    return guided(bytes(data), message_node(type_name))


def unpack(data: bytes) -> Any:
    """Objects of MessagePack bytes; lengths that the input cannot hold are refused before anything is allocated."""
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
