# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Contents octets of one REAL: written in the shortest form, read in every form of X.690 8.5."""

from __future__ import annotations

import math
import re

from cdff_common.errors import CodecError

_SPECIAL = {0x40: float("inf"), 0x41: float("-inf"), 0x42: float("nan"), 0x43: -0.0}
#: ISO 6093 NR1, NR2, NR3.
_DECIMAL = {
    1: re.compile(rb" *[+-]?\d{1,400}\Z"),
    2: re.compile(rb" *[+-]?(\d{1,400}[.,]\d{0,400}|[.,]\d{1,400})\Z"),
    3: re.compile(rb" *[+-]?(\d{1,400}[.,]?\d{0,400}|[.,]\d{1,400})[eE][+-]?\d{1,6}\Z"),
}


def encode_real(value: float) -> bytes:
    """Return the contents octets of a REAL: base 2, odd mantissa, shortest form (X.690 11.3.1)."""
    if value == 0.0:
        return b"\x43" if math.copysign(1.0, value) < 0.0 else b""
    if not math.isfinite(value):
        return b"\x42" if math.isnan(value) else b"\x40" if value > 0.0 else b"\x41"
    fraction, exponent = math.frexp(abs(value))
    mantissa = int(fraction * 2.0**53)
    zeros = (mantissa & -mantissa).bit_length() - 1
    mantissa >>= zeros
    exponent += zeros - 53
    octets = 1 if -128 <= exponent <= 127 else 2
    head = 0x80 | (0x40 if value < 0.0 else 0) | (octets - 1)
    size = (mantissa.bit_length() + 7) // 8
    return bytes([head]) + exponent.to_bytes(octets, "big", signed=True) + mantissa.to_bytes(size, "big")


def decode_real(contents: bytes) -> float:
    """Return the value of the contents octets of a REAL.

    Raises
    ------
    CodecError
        If they are malformed, or the number exceeds float64.
    """
    if not contents:
        return 0.0
    head = contents[0]
    if head & 0x80:
        return _binary(contents)
    if head & 0x40:
        if head in _SPECIAL and len(contents) == 1:
            return _SPECIAL[head]
        raise CodecError(f"REAL {contents[:4].hex()}: expected a special value of one octet, 40 to 43")
    pattern = _DECIMAL.get(head)
    if pattern is None or not pattern.match(contents[1:]):
        raise CodecError(f"REAL {contents[:16].hex()}: expected ISO 6093 NR1, NR2 or NR3")
    return float(contents[1:].replace(b",", b"."))


def _binary(contents: bytes) -> float:
    """Return the number of a binary encoding of REAL (X.690, 8.5.7); raises CodecError."""
    head = contents[0]
    base_bits = {0: 1, 1: 3, 2: 4}.get((head >> 4) & 3)
    exponent_octets = (head & 3) + 1
    first = 1
    if exponent_octets == 4:
        exponent_octets = contents[1] if len(contents) > 1 else 0
        first = 2
    mantissa_octets = contents[first + exponent_octets :]
    if base_bits is None or exponent_octets == 0 or not mantissa_octets:
        raise CodecError(f"REAL {contents[:4].hex()}: malformed binary encoding")
    if exponent_octets > 4:
        raise CodecError(f"REAL with an exponent of {exponent_octets} octets: expected at most 4")
    exponent = int.from_bytes(contents[first : first + exponent_octets], "big", signed=True)
    mantissa = int.from_bytes(mantissa_octets, "big")
    value = _scale(mantissa, exponent * base_bits + ((head >> 2) & 3))
    return -value if head & 0x40 else value


def _scale(mantissa: int, exponent: int) -> float:
    """Return ``mantissa * 2 ** exponent``, rounded once, with bounded intermediate numbers."""
    if mantissa == 0:
        return 0.0
    size = exponent + mantissa.bit_length()
    if size > 1024:
        raise CodecError(f"REAL of magnitude 2^{size}: exceeds float64")
    if size < -1080:
        return 0.0
    try:
        return float(mantissa << exponent) if exponent >= 0 else mantissa / (1 << -exponent)
    except OverflowError as error:
        raise CodecError(f"REAL of magnitude 2^{size}: exceeds float64") from error
