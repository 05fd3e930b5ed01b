# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""UPER and BER through asn1tools: the reference for our own UPER, and the way of BER."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from cdff_common.asn1 import asn1_files
from cdff_common.codecs.bridge import from_asn1, message_node, to_asn1
from cdff_common.codecs.siblings import wire_node
from cdff_common.errors import CodecError, InputError


@cache
def _specification(codec: str) -> Any:
    import asn1tools

    return asn1tools.compile_files([str(p) for p in asn1_files()], codec)


def encode(value: Any, codec: str, type_name: str | None = None) -> bytes:
    """Encode a message with asn1tools (``codec`` ``uper`` or ``ber``)."""
    node = wire_node(value, type_name)
    import asn1tools

    try:
        return bytes(_specification(codec).encode(node.name, to_asn1(value, node)))
    except (asn1tools.EncodeError, ValueError, OverflowError, struct.error) as error:
        raise CodecError(f"{node.name} as {codec}: {error}") from error


def decode(type_name: str, data: bytes, codec: str) -> Any:
    """Decode a message with asn1tools; raises CodecError on bytes that are none."""
    import asn1tools

    node = message_node(type_name)
    try:
        return from_asn1(_specification(codec).decode(node.name, data), node)
    except CodecError:
        raise
    except (
        asn1tools.DecodeError,
        InputError,
        ValueError,
        IndexError,
        KeyError,
        TypeError,
        OverflowError,
        ArithmeticError,
        MemoryError,
        RecursionError,
        struct.error,
    ) as error:
        raise CodecError(f"{node.name} as {codec}, {len(data)} octets: {type(error).__name__} {error}") from error
