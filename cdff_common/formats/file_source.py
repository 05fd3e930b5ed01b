# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bytes of a file and its name in messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from cdff_common.errors import CodecError, InputError

#: A path, bytes, or a loaded file.
Readable: TypeAlias = "bytes | str | Path | Source"

#: Larger files are refused, since none of these formats is read in parts.
LIMIT_BYTES = 4 << 30
#: Limits of the decompressed size: at most 200 times the file size or 64 MiB (small sizes are harmless), and
#: never above 1 GiB.
_RATIO, _HARMLESS_BYTES, _MAX_BYTES = 200, 64 << 20, 1 << 30


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """Bytes of a file and its name in messages.

    Attributes
    ----------
    data : bytes
    name : str
    on_truncation : callable, optional
        Takes the report of an early end of the file, whose complete elements are read; by default such a
        file is refused.
    """

    data: bytes
    name: str
    on_truncation: Callable[[str], object] | None = None

    def error(self, expected: str) -> CodecError:
        """Return an error with the file name and the expectation."""
        return CodecError(f"{self.name}: {expected}")

    def report_truncation(self, complete: int, expected: int, unit: str) -> None:
        """Report that the file ends early.

        Parameters
        ----------
        complete, expected : int
            Number of complete elements, and that of the header.
        unit : str
            Name of the elements, such as ``vertices``.

        Raises
        ------
        CodecError
            If such files are refused, or no element is complete.
        """
        end = f"ends at byte {len(self.data)} after {complete} of {expected} {unit}"
        if self.on_truncation is None or not complete:
            raise self.error(end)
        self.on_truncation(f"{self.name}: {end}; these are read")

    def check_claim(self, claimed_bytes: int, subject: str) -> None:
        """Refuse a file whose header states an implausible or too large size, before any allocation.

        Parameters
        ----------
        claimed_bytes : int
            Decompressed size according to the file header.
        subject : str
            Content of the file for the message, e.g. ``"30000 x 30000 pixels"``.
        """
        limit = min(max(_HARMLESS_BYTES, _RATIO * len(self.data)), _MAX_BYTES)
        if claimed_bytes > limit:
            raise self.error(
                f"{subject} would take {claimed_bytes} bytes out of a file of {len(self.data)}, "
                f"expected at most {limit}"
            )


def load(source: Readable) -> Source:
    """Read a path completely, or wrap bytes; raises InputError with the path."""
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
