# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where the bytes of a file come from, and what messages call it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cdff_common.errors import CodecError, InputError

Readable = bytes | str | Path

#: Larger files are refused: none of these formats is read in pieces.
LIMIT_BYTES = 4 << 30
#: What a compressed file may claim to hold: data of any use are not 200 times as large, small claims are harmless, and
#: beyond the last a file belongs to a program that reads it in pieces.
_RATIO, _HARMLESS_BYTES, _MOST_BYTES = 200, 64 << 20, 1 << 30


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """Bytes and the name that messages give them."""

    data: bytes
    name: str

    def error(self, expected: str) -> CodecError:
        """An error that names the file and what was expected of it."""
        return CodecError(f"{self.name}: {expected}")

    def check_claim(self, claimed_bytes: int, what: str) -> None:
        """Refuse a file that claims to hold more than it can, or than is read at once, before anything is made for it.

        Parameters
        ----------
        claimed_bytes : int
            Of the values unpacked, as the file's own header has it.
        what : str
            For the message, as ``"30000 x 30000 pixels"``.
        """
        most = min(max(_HARMLESS_BYTES, _RATIO * len(self.data)), _MOST_BYTES)
        if claimed_bytes > most:
            raise self.error(
                f"{what} would take {claimed_bytes} bytes out of a file of {len(self.data)}, expected at most {most}"
            )


def load(source: Readable | Source) -> Source:
    """Read a path whole, or take bytes as they are; raises InputError naming the path."""
    if isinstance(source, Source):
        return source
    if isinstance(source, bytes):
        return Source(source, f"{len(source)} bytes")
    path = Path(source)
    try:
        size = path.stat().st_size
        if size > LIMIT_BYTES:
            raise InputError(f"{path}: {size} bytes, expected at most {LIMIT_BYTES}")
        return Source(path.read_bytes(), str(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
