# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs of the InFuse robots and of CDFF: MessagePack files with streams of messages."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.formats.infuse.reader import LogReader


def _files(location: LogLocation) -> list[Path]:
    """Return the ``.msg`` files of a location; ``NAME.msg`` is also the name of a log in chunks."""
    if location.folder is not None:
        return sorted(location.folder.glob("*.msg"))
    if location.files:
        return list(location.files) if _is_map(location) else []
    from cdff_dev.logs.formats.infuse.writer import chunk_files

    name = Path(location.name)
    return chunk_files(name.parent, name.stem) if name.suffix == ".msg" else []


def _is_map(location: LogLocation) -> bool:
    """Return whether the first file is a MessagePack map with a text as first key, or called ``.msg``."""
    if location.files[0].suffix == ".msg":
        return True
    first, *next_bytes = location.head(6) or b"\0"
    # MessagePack: 0x80 to 0x8F are short maps; 0xDE and 0xDF have a count of 2 or 4 bytes.
    key = next_bytes[{0xDE: 2, 0xDF: 4}.get(first, 0) :][:1]
    is_map = first in (0xDE, 0xDF) or 0x80 <= first < 0x90
    # 0xA0 to 0xBF are short texts, 0xD9 and 0xDA longer ones.
    return is_map and bool(key) and (0xA0 <= key[0] < 0xC0 or key[0] in (0xD9, 0xDA))


def _open(location: LogLocation, _: Path | None) -> LogReader:
    from cdff_dev.logs.formats.infuse.reader import LogReader

    return LogReader(_files(location))


FORMAT = LogFormat(
    "InFuse log", ".msg files, or a folder of them", lambda location: bool(_files(location)), _open
)
