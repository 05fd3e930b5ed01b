# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""UPER and BER by asn1tools: the reference for the UPER codec, and the implementation of BER."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from cdff_common.asn1 import asn1_files
from cdff_common.codecs.dict_form import dict_form_of, from_dict_form
from cdff_common.codecs.wire_types import message_node, wire_node
from cdff_common.errors import CodecError, InputError

#: Errors of asn1tools on malformed bytes.
_DECODE_ERRORS = (
    InputError,
    ValueError,
    LookupError,
    TypeError,
    ArithmeticError,
    MemoryError,
    RecursionError,
    struct.error,
)


@cache
def _specification(codec: str) -> Any:
    import asn1tools

    return asn1tools.compile_files([str(p) for p in asn1_files()], codec)


def encode(value: Any, codec: str = "ber", type_name: str | None = None) -> bytes:
    """Encode a message with asn1tools (``codec`` ``uper`` or ``ber``)."""
    node = wire_node(value, type_name)
    import asn1tools

    try:
        return bytes(_specification(codec).encode(node.name, dict_form_of(value, node, asn1tools=True)))
    except (asn1tools.EncodeError, ValueError, OverflowError, struct.error) as error:
        raise CodecError(f"{node.name} as {codec}: {error}") from error


def decode(type_name: str, data: bytes, codec: str = "ber") -> Any:
    """Decode a message with asn1tools; raises CodecError on malformed bytes."""
    import asn1tools

    node = message_node(type_name)
    try:
        return from_dict_form(node.name, _specification(codec).decode(node.name, data), _refuse_deviation)
    except CodecError:
        raise
    except (*_DECODE_ERRORS, asn1tools.DecodeError) as error:
        raise CodecError(
            f"{node.name} as {codec}, {len(data)} bytes: {type(error).__name__} {error}"
        ) from error


def _refuse_deviation(deviation: str) -> None:
    """Raise CodecError for a deviation of the decoded value from the types, except bytes for text."""
    if not deviation.endswith("bytes for text"):
        raise CodecError(deviation)
