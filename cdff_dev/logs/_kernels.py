# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Walks over MessagePack without building objects: what makes an index of a log fast."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

TRUNCATED = -1
MALFORMED = -2


@njit(cache=True, nogil=True)
def _uint(buffer: NDArray[np.uint8], at: int, size: int) -> int:
    value = 0
    for i in range(size):
        value = (value << 8) | np.int64(buffer[at + i])
    return value


@njit(cache=True, nogil=True)
def skip(buffer: NDArray[np.uint8], at: int) -> int:
    """Position after the object at ``at``; TRUNCATED where the buffer ends in it, MALFORMED on a reserved octet."""
    end = buffer.size
    left = 1
    while left > 0:
        if at >= end or left > end - at:
            return TRUNCATED
        b = np.int64(buffer[at])
        at += 1
        left -= 1
        if b < 0x80 or b >= 0xE0 or b == 0xC0 or b == 0xC2 or b == 0xC3:
            continue
        if b < 0x90:
            left += 2 * (b & 15)
        elif b < 0xA0:
            left += b & 15
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
            n = _uint(buffer, at, size)
            at += size
            if kind == 0:
                at += n
            elif kind == 1:
                at += n + 1
            elif kind == 2:
                left += n
            else:
                left += 2 * n
    return at if at <= end else TRUNCATED


@njit(cache=True, nogil=True)
def skip_many(buffer: NDArray[np.uint8], at: int, ends: NDArray[np.int64]) -> int:
    """Skip ``ends.size`` objects and note where each ends; returns how many were whole."""
    for i in range(ends.size):
        after = skip(buffer, at)
        if after < 0:
            return i
        ends[i] = after
        at = after
    return ends.size
