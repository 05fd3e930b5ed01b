# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""LZF decompression, as Marc Lehmann's liblzf writes it (used by PCD binary_compressed)."""

from __future__ import annotations

from cdff_common.errors import CodecError


def lzf_decompress(data: bytes, size: int, name: str = "LZF block") -> bytes:
    """Return the ``size`` bytes that ``data`` stands for; raises CodecError if it stands for anything else.

    A control byte below 32 is a run of that many plus one literal bytes; any other is a back reference: 3 bits of
    length (7: one more byte follows), 13 bits of distance.
    """
    out = bytearray()
    i, end = 0, len(data)
    try:
        while i < end:
            control = data[i]
            i += 1
            if control < 32:
                literal = data[i : i + control + 1]
                if len(literal) != control + 1:
                    raise IndexError("literal run is cut off")
                out += literal
                i += control + 1
            else:
                length = control >> 5
                if length == 7:
                    length += data[i]
                    i += 1
                start = len(out) - ((control & 31) << 8 | data[i]) - 1
                i += 1
                if start < 0:
                    raise IndexError("reference before the beginning")
                length += 2
                if start + length <= len(out):
                    out += out[start : start + length]
                else:  # overlapping: repeats what it has just written
                    period = bytes(out[start:])
                    out += (period * (length // len(period) + 1))[:length]
            if len(out) > size:
                raise IndexError("more bytes than announced")
    except IndexError as error:
        raise CodecError(f"{name}: malformed LZF block: {error}") from error
    if len(out) != size:
        raise CodecError(f"{name}: LZF block gives {len(out)} bytes, expected {size}")
    return bytes(out)
