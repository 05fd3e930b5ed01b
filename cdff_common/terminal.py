# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Text on terminals: colours, verbosity and columns."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import TextIO

#: SGR codes of the styles.
_STYLES = {"bold": "1", "red": "31", "green": "32", "yellow": "33", "faint": "2"}


def styled(text: str, style: str, stream: TextIO) -> str:
    """Return text in a style (bold, red, green, yellow, faint) if the stream is a terminal.

    ``NO_COLOR`` (https://no-color.org) and ``TERM=dumb`` disable styles.
    """
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" or not stream.isatty():
        return text
    return f"\x1b[{_STYLES[style]}m{text}\x1b[0m"


def set_verbosity(steps: int) -> None:
    """Set the level of log lines on standard error: ``-v`` is 1, ``-vv`` 2, ``-q`` -1, and 0 the default."""
    if steps == 0:
        return
    import logging

    level = {-1: logging.ERROR, 1: logging.INFO}.get(max(steps, -1), logging.DEBUG)
    logging.basicConfig(level=level, format="%(levelname)s %(name)s: %(message)s")
    os.environ.setdefault(
        "CDFF_LOG_LEVEL", logging.getLevelName(level)
    )  # of services that the command starts


def is_quiet() -> bool:
    """Return whether only errors are reported (``-q``), and no progress."""
    import logging

    return logging.getLogger().level == logging.ERROR


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """Return lines of left-aligned columns under a header; the last column has any width."""
    texts = [[str(cell) for cell in row] for row in (header, *rows)]
    widths = [max(len(row[column]) for row in texts) for column in range(len(header) - 1)]
    lines = []
    for row in texts:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=False)]
        lines.append("  ".join([*cells, row[-1]]).rstrip())
    return lines


def print_table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print columns; the header is bold on a terminal."""
    first, *others = table(header, rows)
    sys.stdout.write("\n".join([styled(first, "bold", sys.stdout), *others]) + "\n")


def first_sentence(text: str) -> str:
    """Return the first sentence of a description, in one line, with its full stop."""
    words = " ".join(text.split())
    end = next((i for i, c in enumerate(words) if c == "." and words[i + 1 : i + 2] in ("", " ")), None)
    return words if end is None else words[: end + 1]
