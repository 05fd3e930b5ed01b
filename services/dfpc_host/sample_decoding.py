# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Decoding of an input message into a sample of a port."""

from __future__ import annotations

from cdff_common.bus import Message
from cdff_common.codecs import decode
from cdff_common.codecs.encoding import parse_encoding
from cdff_common.codecs.size_variants import base_type
from cdff_common.errors import CodecError, RefusedError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Header, Status


def decode_sample(message: Message, port: str, type_name: str) -> Sample:
    """Decode a message for a port of type ``type_name``.

    Raises
    ------
    CodecError
        If encoding, attachment or payload do not fit the port.
    RefusedError
        If the producer reported FAILED: the message has no value.
    """
    header = Header.from_attachment(message.attachment)
    if header.quality.status is Status.FAILED:
        raise RefusedError(f"{message.key}: its producer reports FAILED", header.quality.reasons)
    name, codec = parse_encoding(message.encoding)
    if base_type(name) != type_name:
        raise CodecError(f"{message.key} carries {name}, port {port} takes {type_name}")
    return Sample(
        port=port,
        stamp_ns=header.t1_ns,
        seq=header.seq,
        value=decode(name, message.payload, codec),
        id=header.id,
        frame=header.frame,
        child=header.child or "",
        quality=header.quality,
    )
