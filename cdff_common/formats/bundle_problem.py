# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Detection of bundle adjustment files by their counts."""

from __future__ import annotations

import struct


def looks_like_bal(words: list[list[str]]) -> bool:
    """Return whether the first lines are those of a BAL file: three counts, then two indices and two
    numbers.
    """
    if len(words) < 2 or len(words[0]) != 3 or len(words[1]) != 4:
        return False
    return all(w.isdigit() for w in (*words[0], *words[1][:2]))


def looks_like_libmv(data: bytes) -> bool:
    """Return whether the bytes start as a libmv problem and have the length of its counts."""
    if len(data) < 46 or data[:1] not in (b"v", b"V") or data[1:2] not in (b"P", b"N"):
        return False
    order = "<" if data[:1] == b"v" else ">"
    at = 34
    for size in (52, 16, 16):
        if at + 4 > len(data):
            return False
        (count,) = struct.unpack_from(f"{order}i", data, at)
        if count < 0:
            return False
        at += 4 + size * count
    return at == len(data)
