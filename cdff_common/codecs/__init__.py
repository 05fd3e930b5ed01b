# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bytes to messages and back: ``encode(value, codec)``, ``decode(type_name, data, codec)``.

Codecs are ``uper`` (the wire's default), ``ber``, ``xer`` and ``msgpack``. NaN is a value: unknown covariances
travel as NaN in all of them. Every decoder raises only ``CodecError``, and allocates no more than its input calls for.
"""

from __future__ import annotations

from typing import Any

from cdff_common.codecs.encoding import CODECS, encoding_string, parse_encoding
from cdff_common.errors import CodecError

__all__ = ["CODECS", "decode", "encode", "encoding_string", "parse_encoding"]


def encode(value: Any, codec: str = "uper", type_name: str | None = None) -> bytes:
    """Encode a message of ``cdff_common.types``.

    Parameters
    ----------
    value : Message
    codec : str
        ``uper``, ``ber``, ``xer`` or ``msgpack``.
    type_name : str, optional
        ASN.1 type to write it as, one of two siblings; by default the smaller that holds it, see ``wire_type``.

    Raises
    ------
    CodecError
        If the codec is unknown, or the value cannot be encoded or is too large for ``type_name``.
    """
    if not getattr(type(value), "ASN1_NAME", ""):
        raise CodecError(f"{type(value).__name__}: expected a message of cdff_common.types")
    if codec == "msgpack":
        from cdff_common.codecs import messagepack

        return messagepack.encode(value, type_name)
    if codec == "uper":
        from cdff_common.codecs import uper

        return uper.encode(value, type_name)
    if codec == "ber":
        from cdff_common.codecs import reference

        return reference.encode(value, codec, type_name)
    if codec == "xer":
        from cdff_common.codecs import xer

        return xer.encode(value, type_name)
    raise CodecError(f"codec {codec!r}: expected one of {', '.join(CODECS)}")


def decode(type_name: str, data: bytes, codec: str = "uper") -> Any:
    """Decode a message; ``type_name`` is its ASN.1 name or class name.

    Raises
    ------
    CodecError
        If the codec or the type is unknown, or the bytes are not such a message.
    """
    if codec == "msgpack":
        from cdff_common.codecs import messagepack

        return messagepack.decode(type_name, data)
    if codec == "uper":
        from cdff_common.codecs import uper

        return uper.decode(type_name, data)
    if codec == "ber":
        from cdff_common.codecs import reference

        return reference.decode(type_name, data, codec)
    if codec == "xer":
        from cdff_common.codecs import xer

        return xer.decode(type_name, data)
    raise CodecError(f"codec {codec!r}: expected one of {', '.join(CODECS)}")
