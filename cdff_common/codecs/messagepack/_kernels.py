# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scanning of MessagePack without building objects, for the index of a log and for lists of numbers."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Integers of Python and of compiled code.
AnyInt = int | np.int64

TRUNCATED = -1
MALFORMED = -2


@njit(cache=True, nogil=True)
def _uint(buffer: NDArray[np.uint8], at: AnyInt, size: AnyInt) -> AnyInt:
    value: AnyInt = 0
    for i in range(size):
        value = (value << 8) | np.int64(buffer[at + i])
    return value


@njit(cache=True, nogil=True)
def skip(buffer: NDArray[np.uint8], at: AnyInt) -> AnyInt:
    """Return the position after the object at ``at``, TRUNCATED if the buffer ends in it, MALFORMED on a
    reserved byte.
    """
    end = buffer.size
    remaining: AnyInt = 1
    while remaining > 0:
        if at >= end or remaining > end - at:
            return TRUNCATED
        b = np.int64(buffer[at])
        at += 1
        remaining -= 1
        if b < 0x80 or b >= 0xE0 or b == 0xC0 or b == 0xC2 or b == 0xC3:
            continue
        if b < 0x90:
            remaining += 2 * (b & 15)
        elif b < 0xA0:
            remaining += b & 15
        elif b < 0xC0:
            at += b & 31
        elif b == 0xC1:
            return MALFORMED
        elif b == 0xCA or b == 0xCE or b == 0xD2:
            at += 4
        elif b == 0xCB or b == 0xCF or b == 0xD3:
            at += 8
        elif b == 0xCC or b == 0xD0:
            at += 1
        elif b == 0xCD or b == 0xD1:
            at += 2
        elif 0xD4 <= b <= 0xD8:
            at += 1 + (1 << (b - 0xD4))
        else:
            if b <= 0xC6:  # bin 8, 16, 32
                size, kind = 1 << (b - 0xC4), 0
            elif b <= 0xC9:  # ext 8, 16, 32
                size, kind = 1 << (b - 0xC7), 1
            elif b <= 0xDB:  # str 8, 16, 32
                size, kind = 1 << (b - 0xD9), 0
            elif b <= 0xDD:  # array 16, 32
                size, kind = 2 << (b - 0xDC), 2
            else:  # map 16, 32
                size, kind = 2 << (b - 0xDE), 3
            if at + size > end:
                return TRUNCATED
            length = _uint(buffer, at, size)
            at += size
            if kind == 0:
                at += length
            elif kind == 1:
                at += length + 1
            elif kind == 2:
                remaining += length
            else:
                remaining += 2 * length
    return at if at <= end else TRUNCATED


@njit(cache=True, nogil=True)
def skip_many(buffer: NDArray[np.uint8], at: AnyInt, ends: NDArray[np.int64]) -> AnyInt:
    """Skip ``ends.size`` objects and store the end of each; return the number of complete objects."""
    for i in range(ends.size):
        after = skip(buffer, at)
        if after < 0:
            return i
        ends[i] = after
        at = after
    return ends.size


@njit(cache=True, nogil=True)
def read_reals(
    buffer: NDArray[np.uint8],
    at: AnyInt,
    rows: int,
    columns: int,
    values: NDArray[np.float64],
    bits: NDArray[np.int64],
) -> AnyInt:
    """Read ``rows`` numbers, or ``rows`` lists of ``columns`` numbers, from ``at``.

    Parameters
    ----------
    columns : int
        0 for a list of numbers.
    values, bits : NDArray[np.float64], NDArray[np.int64]
        Two views of the same memory.

    Returns
    -------
    int
        Following position; MALFORMED on anything other than such lists of numbers.
    """
    end = buffer.size
    single_bits = np.zeros(1, dtype=np.uint32)
    single = single_bits.view(np.float32)
    k = 0
    for _ in range(rows):
        count = 1
        if columns > 0:
            count = columns
            if at >= end:
                return MALFORMED
            if columns < 16 and buffer[at] == 0x90 | columns:
                at += 1
            elif buffer[at] == 0xDC and at + 3 <= end and _uint(buffer, at + 1, 2) == columns:
                at += 3
            else:
                return MALFORMED
        for _ in range(count):
            if at >= end:
                return MALFORMED
            b = np.int64(buffer[at])
            if b == 0xCB:
                if at + 9 > end:
                    return MALFORMED
                bits[k] = _uint(buffer, at + 1, 8)
                at += 9
            elif b == 0xCA:
                if at + 5 > end:
                    return MALFORMED
                single_bits[0] = np.uint32(_uint(buffer, at + 1, 4))
                values[k] = single[0]
                at += 5
            else:
                number, at = _integer(buffer, at)
                if at < 0:
                    return MALFORMED
                values[k] = number
            k += 1
    return at


@njit(cache=True, nogil=True)
def _integer(buffer: NDArray[np.uint8], at: AnyInt) -> tuple[AnyInt, AnyInt]:
    """Return an integer and the following position; MALFORMED on anything else, and above int64."""
    end = buffer.size
    b = np.int64(buffer[at])
    if b < 0x80:
        return b, at + 1
    if b >= 0xE0:
        return b - 256, at + 1
    if 0xCC <= b <= 0xCE:
        size = 1 << (b - 0xCC)
        if at + 1 + size > end:
            return 0, MALFORMED
        return _uint(buffer, at + 1, size), at + 1 + size
    if 0xD0 <= b <= 0xD3:
        size = 1 << (b - 0xD0)
        if at + 1 + size > end:
            return 0, MALFORMED
        value = _uint(buffer, at + 1, size)
        if size < 8 and value >= 1 << (8 * size - 1):
            value -= 1 << (8 * size)
        return value, at + 1 + size
    return 0, MALFORMED


@njit(cache=True, nogil=True)
def read_integers(buffer: NDArray[np.uint8], at: AnyInt, values: NDArray[np.int64]) -> AnyInt:
    """Read integers from ``at``; return the following position, or MALFORMED on anything else."""
    for k in range(values.size):
        if at >= buffer.size:
            return MALFORMED
        number, at = _integer(buffer, at)
        if at < 0:
            return MALFORMED
        values[k] = number
    return at
