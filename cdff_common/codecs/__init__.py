# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Encoding and decoding of messages: ``encode(value, codec)``, ``decode(type_name, data, codec)``.

Codecs are ``uper`` (the default), ``ber``, ``xer`` and ``msgpack``. All preserve NaN, the value of unknown
covariances. Every decoder raises only ``CodecError``, and allocates no more than its input requires.
A payload has an encoding string, e.g. ``application/vnd.cdff+uper;Pointcloud/1``.
"""

from __future__ import annotations

import re
from functools import cache
from importlib import import_module
from typing import Any

from cdff_common.errors import CodecError

CODECS = ("uper", "ber", "xer", "msgpack")
WIRE_VERSION = 1
_ENCODING = re.compile(r"application/vnd\.cdff\+([a-z]+);([A-Za-z][A-Za-z0-9-]*)/(\d{1,6})\Z")
#: Types with a compact form, see ``compact_maps``.
_COMPACTED = frozenset({"ElevationMap", "NavigationMap"})
#: Largest size of the whole layers of a map, divided by that of its compact form; this bounds the memory that
#: a decoder allocates for a message.
MAX_EXPANSION = 64
#: Modules whose name is not that of the codec.
MODULES = {"ber": "reference", "msgpack": "messagepack"}

__all__ = [
    "CODECS",
    "decode",
    "decode_payload",
    "encode",
    "encode_payload",
    "encoding_string",
    "parse_encoding",
]


def encode(value: Any, codec: str = "uper", type_name: str | None = None) -> bytes:
    """Encode a message of ``cdff_common.types``.

    Parameters
    ----------
    value : Message
    codec : str
        ``uper``, ``ber``, ``xer`` or ``msgpack``.
    type_name : str, optional
        ASN.1 type, one of the size variants; by default the smaller one that fits, see ``wire_type``.

    Raises
    ------
    CodecError
        If the codec is unknown, or the value cannot be encoded or is too large for ``type_name``.
    """
    if not getattr(type(value), "ASN1_NAME", ""):
        raise CodecError(f"{type(value).__name__}: expected a message of cdff_common.types")
    if codec == "uper" and value.ASN1_NAME in _COMPACTED:
        from cdff_common.codecs.compact_maps import compact

        value = compact(value)
    data: bytes = _implementation(codec).encode(value, type_name=type_name)
    return data


def decode(type_name: str, data: bytes, codec: str = "uper") -> Any:
    """Decode a message; ``type_name`` is its ASN.1 name or class name.

    Raises
    ------
    CodecError
        If the codec or the type is unknown, or the bytes are not a message of that type.
    """
    value = _implementation(codec).decode(type_name, data)
    if value.ASN1_NAME not in _COMPACTED:
        return value
    from cdff_common.codecs.compact_maps import expanded

    return expanded(value)


@cache
def _implementation(codec: str) -> Any:
    """Return the module of a codec, loaded at its first use."""
    if codec not in CODECS:
        raise CodecError(f"codec {codec!r}: expected one of {', '.join(CODECS)}")
    return import_module(f"cdff_common.codecs.{MODULES.get(codec, codec)}")


def encode_payload(value: Any, codec: str = "uper") -> tuple[bytes, str]:
    """Return a message as payload and encoding string; raises CodecError."""
    from cdff_common.codecs.wire_types import wire_type

    return encode(value, codec), encoding_string(wire_type(value), codec)


def decode_payload(payload: bytes, encoding: str) -> Any:
    """Return the message in a payload with its encoding string; raises CodecError."""
    type_name, codec = parse_encoding(encoding)
    return decode(type_name, payload, codec)


def encoding_string(type_name: str, codec: str) -> str:
    """Return the encoding string of a payload of ``type_name`` in ``codec``."""
    if codec not in CODECS:
        raise CodecError(f"codec {codec!r}: expected one of {', '.join(CODECS)}")
    return f"application/vnd.cdff+{codec};{type_name}/{WIRE_VERSION}"


def parse_encoding(text: str) -> tuple[str, str]:
    """Return (type name, codec) of an encoding string.

    Raises
    ------
    CodecError
        If it is not a CDFF encoding, or has another wire version.
    """
    match = _ENCODING.match(text)
    if not match or match[1] not in CODECS:
        raise CodecError(f"encoding {text!r}: expected e.g. {encoding_string('Pointcloud', 'uper')}")
    if int(match[3]) != WIRE_VERSION:
        raise CodecError(f"encoding {text!r}: wire version {match[3]}, expected {WIRE_VERSION}")
    return match[2], match[1]
