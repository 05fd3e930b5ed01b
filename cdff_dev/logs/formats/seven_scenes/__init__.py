# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sequences of the RGB-D data set 7-Scenes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.indexed import IndexedLog

#: Colour image of a frame: ``frame-000000.color.png``, or in extracts ``000000.color.jpg``.
COLOUR_NAME = re.compile(r"(?:frame-)?(\d{6})\.color\.(?:png|jpg)$")


def folder_of_frames(folder: Path) -> Path | None:
    """Return ``folder`` or its sub-folder ``frames``, whichever contains the images; None if neither does."""
    for candidate in (folder, folder / "frames"):
        if candidate.is_dir() and any(COLOUR_NAME.match(file.name) for file in candidate.iterdir()):
            return candidate
    return None


def _recognises(location: LogLocation) -> bool:
    return location.folder is not None and folder_of_frames(location.folder) is not None


def _open(location: LogLocation, _: Path | None) -> IndexedLog:
    from cdff_dev.logs.formats.seven_scenes.sequence import sequence_log

    frames = folder_of_frames(location.folder) if location.folder else None
    assert frames is not None
    return sequence_log(frames)


FORMAT = LogFormat("7-Scenes sequence", "a folder with frame-000000.color.png", _recognises, _open)
