# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point clouds as text: a line per point, of 3, 4, 6 or 7 columns.

They are ``x y z``, ``x y z intensity``, ``x y z r g b`` or ``x y z intensity r g b``.

Separators are blanks, commas or semicolons. Comments (``#``, ``//``) and a first line of names or of the
number of points are skipped.
"""

from __future__ import annotations

import numpy as np

from cdff_common.errors import CodecError
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.file_source import Readable, Source, load

#: x y z, with intensity, with colour, or with both.
_COLUMNS = (3, 4, 6, 7)
_SEPARATORS = str.maketrans(",;", "  ")


def read_xyz(source: Readable) -> CloudArrays:
    """Read a cloud; raises CodecError with file and line for other content."""
    s = load(source)
    try:
        text = s.data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise s.error(f"byte {error.start}: not text, expected lines x y z") from error
    lines = [(number, line.split("#")[0].split("//")[0]) for number, line in enumerate(text.splitlines(), 1)]
    words = [(number, line.translate(_SEPARATORS).split()) for number, line in lines]
    rows = [(number, row) for number, row in words if row]
    if rows and not _is_point(rows[0][1]):
        rows = rows[1:]
    if not rows:
        raise s.error("no points, expected lines x y z")
    columns = len(rows[0][1])
    wrong = next((number for number, row in rows if len(row) != columns), None)
    if columns not in _COLUMNS or wrong is not None:
        line, count = (rows[0][0], columns) if wrong is None else (wrong, "another number of")
        raise s.error(f"line {line}: {count} columns, expected {', '.join(map(str, _COLUMNS))} in all lines")
    try:
        values = np.array([row for _, row in rows], dtype=np.float64)
    except ValueError as error:
        raise _error_with_line(s, rows) from error
    colors = values[:, -3:] if columns >= 6 else None
    if colors is not None and not np.all((colors >= 0) & (colors <= 255)):
        raise s.error("colours beyond 0 to 255 in the last three columns")
    return CloudArrays.of(values[:, :3], values[:, 3] if columns in (4, 7) else None, colors)


def looks_like_xyz(head: bytes) -> bool:
    """Return whether the first lines of a file are points."""
    lines = head.decode("utf-8", "replace").splitlines()[:-1]
    rows = [line.translate(_SEPARATORS).split() for line in lines if line.strip() and line[:1] not in "#/"]
    rows = rows[1:] if rows and not _is_point(rows[0]) else rows
    return bool(rows) and all(_is_point(row) and len(row) == len(rows[0]) for row in rows)


def _is_point(row: list[str]) -> bool:
    """Return whether all words of a row are numbers, as many as a point has."""
    try:
        return len([float(word) for word in row]) in _COLUMNS
    except ValueError:
        return False


def _error_with_line(s: Source, rows: list[tuple[int, list[str]]]) -> CodecError:
    """Return the error that names the first line without numbers."""
    number = next((number for number, row in rows if not _is_point(row)), rows[0][0])
    return s.error(f"line {number}: not numbers, expected x y z")
