# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs of ROCK: pocolog files of version 2."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.formats.pocolog.log import PocologLog

#: First bytes of a log file; those of its index file continue with another character.
_MAGIC = b"POCOSIM\0"


def _is_log_file(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC


def _files(location: LogLocation) -> list[Path]:
    """Return the log files of a location."""
    candidates = location.folder.glob("*.log") if location.folder else location.files
    return [path for path in candidates if path.is_file() and _is_log_file(path)]


def _open(location: LogLocation, _: Path | None) -> PocologLog:
    from cdff_dev.logs.formats.pocolog.log import PocologLog

    return PocologLog(_files(location))


FORMAT = LogFormat(
    "pocolog", ".log files of ROCK, or a folder of them", lambda location: bool(_files(location)), _open
)
