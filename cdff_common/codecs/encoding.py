# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The encoding strings that say what a payload is: ``application/vnd.cdff+uper;Pointcloud/1`` (contract §5)."""

from __future__ import annotations

import re

from cdff_common.errors import CodecError

CODECS = ("uper", "ber", "xer", "msgpack")
WIRE_VERSION = 1
_PATTERN = re.compile(r"application/vnd\.cdff\+([a-z]+);([A-Za-z][A-Za-z0-9-]*)/(\d{1,6})\Z")


def encoding_string(type_name: str, codec: str) -> str:
    """Encoding of a payload of ``type_name`` in ``codec``."""
    if codec not in CODECS:
        raise CodecError(f"codec {codec!r}: expected one of {', '.join(CODECS)}")
    return f"application/vnd.cdff+{codec};{type_name}/{WIRE_VERSION}"


def parse_encoding(text: str) -> tuple[str, str]:
    """Return (type name, codec) of an encoding string.

    Raises
    ------
    CodecError
        If it is not one of ours, or of another wire version.
    """
    found = _PATTERN.match(text)
    if not found or found[1] not in CODECS:
        raise CodecError(f"encoding {text!r}: expected as {encoding_string('Pointcloud', 'uper')}")
    if int(found[3]) != WIRE_VERSION:
        raise CodecError(f"encoding {text!r}: wire version {found[3]}, expected {WIRE_VERSION}")
    return found[2], found[1]
