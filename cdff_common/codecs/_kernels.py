# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of UPER: lists of REAL, and bytes at odd bit offsets.

A REAL is a length octet and its contents by X.690 8.5: empty for +0, one octet for -0 (0x43), the infinities
(0x40, 0x41) and NaN (0x42), else base 2 with an odd mantissa in the smallest number of octets (X.690 11.3.1).
The reader also accepts mantissas that are even or have leading zeros, which asn1scc writes. For the other
forms of the standard, handled by ``real.py``, the loop returns its position.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Largest size of a REAL, bytes: 1 for length, 1 for header, 2 for exponent, 7 for mantissa.
REAL_MAX_OCTETS = 11
#: Bytes of padding behind a message, since the loops load eight bytes at a time.
READ_PADDING = 24

_POWERS = 2.0 ** np.arange(-1022, 1024, dtype=np.float64)


@njit(cache=True, nogil=True, inline="always")
def _load(buffer: NDArray[np.uint8], at: int, shift: int) -> np.uint64:
    """Return 64 bits from byte ``at`` and bit ``shift`` within it."""
    word = (
        (np.uint64(buffer[at]) << np.uint64(56))
        | (np.uint64(buffer[at + 1]) << np.uint64(48))
        | (np.uint64(buffer[at + 2]) << np.uint64(40))
        | (np.uint64(buffer[at + 3]) << np.uint64(32))
        | (np.uint64(buffer[at + 4]) << np.uint64(24))
        | (np.uint64(buffer[at + 5]) << np.uint64(16))
        | (np.uint64(buffer[at + 6]) << np.uint64(8))
        | np.uint64(buffer[at + 7])
    )
    return (word << np.uint64(shift)) | (np.uint64(buffer[at + 8]) >> np.uint64(8 - shift))


@njit(cache=True, nogil=True, inline="always")
def _store(out: NDArray[np.uint8], at: int, shift: int, word: np.uint64, octets: int) -> None:
    """Write the upper ``octets`` (1 to 7) of a word at byte ``at`` and bit ``shift``; clear the following
    bits.
    """
    head = word >> np.uint64(shift)
    out[at] |= np.uint8(head >> np.uint64(56))
    for i in range(1, 8):
        out[at + i] = np.uint8((head >> np.uint64(56 - 8 * i)) & np.uint64(0xFF))
    if octets == 7:
        out[at + 8] = np.uint8(0)


@njit(cache=True, nogil=True)
def encode_reals(bits: NDArray[np.int64], out: NDArray[np.uint8], shift: int) -> int:
    """Write REALs from bit ``shift`` of ``out[0]``, whose upper bits are preserved.

    Parameters
    ----------
    bits : NDArray[np.int64], shape (n,)
        The float64 values, viewed as integers.
    out : NDArray[np.uint8], shape (at least 11 n + 16,)

    Returns
    -------
    int
        Bytes written; the last bits are in the following byte.
    """
    at: int = 0
    for i in range(bits.size):
        b = np.uint64(bits[i])
        exponent = np.int64((b >> np.uint64(52)) & np.uint64(0x7FF))
        mantissa = b & np.uint64(0xFFFFFFFFFFFFF)
        negative = np.int64(b >> np.uint64(63))
        if exponent == 0x7FF:
            code = 0x42 if mantissa else 0x40 + negative
            _store(out, at, shift, np.uint64(0x0100 | code) << np.uint64(48), 2)
            at += 2
            continue
        if exponent == 0:
            if mantissa == 0:
                if negative:
                    _store(out, at, shift, np.uint64(0x0143) << np.uint64(48), 2)
                    at += 2
                else:
                    _store(out, at, shift, np.uint64(0), 1)
                    at += 1
                continue
            exponent = np.int64(1)
        else:
            mantissa |= np.uint64(1) << np.uint64(52)
        exponent -= 1075
        while mantissa & np.uint64(0xFF) == 0:
            mantissa >>= np.uint64(8)
            exponent += 8
        while mantissa & np.uint64(1) == 0:
            mantissa >>= np.uint64(1)
            exponent += 1
        size = 7 if mantissa >> np.uint64(48) else 1
        if size == 1:
            rest = mantissa >> np.uint64(8)
            while rest:
                size += 1
                rest >>= np.uint64(8)
        if -128 <= exponent <= 127:
            head = np.uint64(((2 + size) << 16) | ((0x80 | (negative << 6)) << 8) | (exponent & 0xFF))
            _store(out, at, shift, head << np.uint64(40), 3)
            at += 3
        else:
            head = np.uint64(((3 + size) << 24) | ((0x81 | (negative << 6)) << 16) | (exponent & 0xFFFF))
            _store(out, at, shift, head << np.uint64(32), 4)
            at += 4
        _store(out, at, shift, mantissa << np.uint64(64 - 8 * size), size)
        at += size
    return at


@njit(cache=True, nogil=True)
def decode_reals(
    buffer: NDArray[np.uint8], at: int, shift: int, end: int, values: NDArray[np.float64]
) -> tuple[int, int]:
    """Read REALs from byte ``at`` and bit ``shift``.

    Parameters
    ----------
    buffer : NDArray[np.uint8]
        Message with ``READ_PADDING`` bytes behind it.
    end : int
        Byte at which the message ends (the last bits, below ``shift``, may be in it).
    values : NDArray[np.float64], shape (n,)
        Filled in order.

    Returns
    -------
    tuple of int
        Number of values read, and the following byte. Fewer than n if a REAL is truncated, or of a form that
        this loop does not support.
    """
    for i in range(values.size):
        if at >= end:
            return i, at
        word = _load(buffer, at, shift)
        size = np.int64(word >> np.uint64(56))
        head = np.int64((word >> np.uint64(48)) & np.uint64(0xFF))
        if size >= 128 or at + 1 + size > end:
            return i, at
        if size == 0:
            values[i] = 0.0
            at += 1
            continue
        if size == 1:
            if head == 0x42:
                values[i] = np.nan
            elif head == 0x40:
                values[i] = np.inf
            elif head == 0x41:
                values[i] = -np.inf
            elif head == 0x43:
                values[i] = -0.0
            else:
                return i, at
            at += 2
            continue
        kind = head & 0xBF
        if kind == 0x80:
            exponent = np.int64((word >> np.uint64(40)) & np.uint64(0xFF))
            exponent -= (exponent & 0x80) << 1
            first = 3
        elif kind == 0x81:
            exponent = np.int64((word >> np.uint64(32)) & np.uint64(0xFFFF))
            exponent -= (exponent & 0x8000) << 1
            first = 4
        else:
            return i, at
        octets = size + 1 - first
        if octets < 1 or octets > 8:
            return i, at
        mantissa = _load(buffer, at + first, shift) >> np.uint64(64 - 8 * octets)
        # asn1scc pads mantissas with zeros at their end
        while mantissa >> np.uint64(53) and mantissa & np.uint64(1) == 0:
            mantissa >>= np.uint64(1)
            exponent += 1
        if mantissa >> np.uint64(53) or exponent > 900 or exponent < -1500:
            return i, at
        value = np.float64(mantissa)
        if exponent < -950:
            # exact first step, so that a denormal result is rounded once
            value = value * _POWERS[1022 - 500] * _POWERS[exponent + 500 + 1022]
        else:
            value = value * _POWERS[exponent + 1022]
        values[i] = -value if head & 0x40 else value
        at += int(size) + 1
    return values.size, at


@njit(cache=True, nogil=True)
def write_bytes(octets: NDArray[np.uint8], out: NDArray[np.uint8], shift: int) -> None:
    """Write bytes from bit ``shift`` (1 to 7) of ``out[0]``; ``out`` is one byte longer."""
    out[0] |= octets[0] >> np.uint8(shift)
    for i in range(1, octets.size):
        out[i] = (octets[i - 1] << np.uint8(8 - shift)) | (octets[i] >> np.uint8(shift))
    out[octets.size] = octets[octets.size - 1] << np.uint8(8 - shift)


@njit(cache=True, nogil=True)
def read_bytes(buffer: NDArray[np.uint8], at: int, shift: int, out: NDArray[np.uint8]) -> None:
    """Read bytes from byte ``at`` and bit ``shift`` (1 to 7)."""
    for i in range(out.size):
        out[i] = (buffer[at + i] << np.uint8(shift)) | (buffer[at + i + 1] >> np.uint8(8 - shift))
