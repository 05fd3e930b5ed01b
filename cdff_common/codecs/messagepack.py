# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MessagePack of the plain form: one message, one map."""

from __future__ import annotations

from typing import Any

import msgpack

from cdff_common.codecs.plain import from_plain, to_plain
from cdff_common.errors import CodecError


def encode(value: Any) -> bytes:
    """MessagePack of ``to_plain(value)``."""
    return bytes(msgpack.packb(to_plain(value), unicode_errors="surrogateescape"))


def decode(type_name: str, data: bytes) -> Any:
    """Inverse of ``encode``; also reads samples of InFuse logs.

    Raises
    ------
    CodecError
        If the bytes are not MessagePack, or not of that type.
    """
    try:
        plain = unpack(data)
    except CodecError as error:
        raise CodecError(f"{type_name} (msgpack): {error}") from error
    return from_plain(type_name, plain)


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
        raise CodecError(f"{size} octets are not MessagePack: {type(error).__name__} {error}") from error
