# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The ``Range`` header (RFC 9110 §14), one range of bytes."""

from __future__ import annotations

import re

from fastapi import HTTPException

_RANGE = re.compile(r"bytes=(\d{0,19})-(\d{0,19})\Z")


def parse_range(header: str | None, size: int) -> tuple[int, int] | None:
    """Return the first and last requested byte, inclusive; None for the whole payload.

    A malformed header, or one with several ranges, is ignored, as the RFC allows.

    Raises
    ------
    HTTPException
        416 if the range begins beyond the end.
    """
    match = _RANGE.match(header.strip()) if header else None
    if match is None or match.group(1) == match.group(2) == "":
        return None
    first, last = match.groups()
    if first == "":
        start, stop = max(size - int(last), 0), size - 1
    else:
        start, stop = int(first), min(int(last), size - 1) if last else size - 1
        if last and int(last) < start:
            return None
    if start >= size or stop < start:
        raise HTTPException(
            416, f"range {header!r} of {size} bytes", headers={"Content-Range": f"bytes */{size}"}
        )
    return start, stop
