# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bitstream message: an encoded message with the name of its type, as logged by InFuse robots."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.codecs import decode, encode
from cdff_common.codecs.wire_types import wire_type
from cdff_common.errors import CodecError
from cdff_common.types import Asn1Bitstream

#: Codecs by ``serialization-method``; 0 was written by InFuse robots, the others are CDFF extensions.
METHODS = ("uper", "ber", "xer", "msgpack")


def wrap(value: Any, codec: str = "uper") -> Asn1Bitstream:
    """Encode a message into a bitstream message."""
    if codec not in METHODS:
        raise CodecError(f"codec {codec!r}: expected one of {', '.join(METHODS)}")
    type_name = wire_type(value)
    data = np.frombuffer(encode(value, codec, type_name), dtype=np.uint8)
    return Asn1Bitstream(type=type_name, serialization_method=METHODS.index(codec), data=data)


def unwrap(bitstream: Asn1Bitstream) -> Any:
    """Decode the content of a bitstream message; raises CodecError on an unknown method or type, or malformed
    data.
    """
    method = bitstream.serialization_method
    if method >= len(METHODS):
        methods = ", ".join(f"{i} {name}" for i, name in enumerate(METHODS))
        raise CodecError(f"Asn1Bitstream.serialization_method={method}: expected {methods}")
    return decode(bitstream.type, bitstream.data.tobytes(), METHODS[method])
