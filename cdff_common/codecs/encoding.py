# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Encoding strings of payloads, e.g. ``application/vnd.cdff+uper;Pointcloud/1``."""

from __future__ import annotations

import re

from cdff_common.errors import CodecError

CODECS = ("uper", "ber", "xer", "msgpack")
WIRE_VERSION = 1
_PATTERN = re.compile(r"application/vnd\.cdff\+([a-z]+);([A-Za-z][A-Za-z0-9-]*)/(\d{1,6})\Z")


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
    match = _PATTERN.match(text)
    if not match or match[1] not in CODECS:
        raise CodecError(f"encoding {text!r}: expected e.g. {encoding_string('Pointcloud', 'uper')}")
    if int(match[3]) != WIRE_VERSION:
        raise CodecError(f"encoding {text!r}: wire version {match[3]}, expected {WIRE_VERSION}")
    return match[2], match[1]
