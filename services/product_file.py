# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of encoded products that wait to be stored: lengths, checksum, header as MessagePack, payload."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zlib import crc32

from cdff_common.bus.message import pack, unpack
from cdff_common.errors import CodecError

#: Length of the header; CRC-32 of header and payload.
_PREFIX = struct.Struct("<II")


def product_file(fields: Mapping[str, Any], payload: bytes) -> bytes:
    """Return the content of the file of a product with the given fields of its header."""
    header = pack(dict(fields))
    return _PREFIX.pack(len(header), crc32(payload, crc32(header))) + header + payload


def read_product_file(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return header and payload of a file.

    Raises
    ------
    OSError
        If the file cannot be read.
    CodecError
        If it is corrupt.
    """
    data = path.read_bytes()
    try:
        length, checksum = _PREFIX.unpack_from(data)
        if crc32(memoryview(data)[_PREFIX.size :]) != checksum:
            raise CodecError("the CRC-32 does not match")
        end = _PREFIX.size + length
        header = unpack(data[_PREFIX.size : end])
        if not isinstance(header, dict):
            raise CodecError(f"a {type(header).__name__} as header, expected a map")
        return header, data[end:]
    except (struct.error, CodecError) as error:
        raise CodecError(f"{path}: expected a product: {error}") from error
