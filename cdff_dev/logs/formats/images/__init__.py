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
    """Return whether a location consists of image files, or contains sequences of them."""
    from cdff_dev.logs.formats.images.sequences import image_sequences
    from cdff_dev.logs.image_streams import IMAGE_SUFFIXES

    if location.folder is None:
        return bool(location.files) and all(f.suffix.lower() in IMAGE_SUFFIXES for f in location.files)
    return bool(image_sequences(location.folder))


def _open(location: LogLocation, calibration: Path | None) -> IndexedLog:
    from cdff_dev.logs.formats.images.folder import files_log, folder_log

    if location.folder is None:
        return files_log(location.files, calibration)
    return folder_log(location.folder, calibration)


FORMAT = LogFormat(
    "image folder",
    "an image, a pattern of images, or a folder of them or with sub-folders; camera.yaml or camera.json",
    _recognises,
    _open,
    takes_calibration=True,
    is_generic=True,
)
