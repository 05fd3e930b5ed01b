# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Folders of images of one or several cameras."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.indexed import IndexedLog


def _recognises(location: LogLocation) -> bool:
    if location.folder is None:
        return False
    from cdff_dev.logs.formats.images.sequences import image_sequences

    return bool(image_sequences(location.folder))


def _open(location: LogLocation, calibration: Path | None) -> IndexedLog:
    from cdff_dev.logs.formats.images.folder import folder_log

    assert location.folder is not None
    return folder_log(location.folder, calibration)


FORMAT = LogFormat(
    "image folder",
    "images in a folder or its sub-folders, with camera.yaml or camera.json",
    _recognises,
    _open,
    takes_calibration=True,
    is_generic=True,
)
