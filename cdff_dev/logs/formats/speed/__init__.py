# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of the spacecraft pose data sets SPEED and SPEED+."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.indexed import IndexedLog

_LABELS = ("train.json", "validation.json", "test.json")


def label_files(folder: Path) -> list[Path]:
    """Return the files with labels of a folder."""
    return [folder / name for name in _LABELS if (folder / name).is_file()]


def _recognises(location: LogLocation) -> bool:
    """Return whether a folder has labels and the camera of a SPEED data set."""
    folder = location.folder
    if folder is None or not label_files(folder):
        return False
    return any((parent / "camera.json").is_file() for parent in (folder, folder.resolve().parent))


def _open(location: LogLocation, calibration: Path | None) -> IndexedLog:
    from cdff_dev.logs.formats.speed.labelled import labelled_log

    assert location.folder is not None
    return labelled_log(location.folder, calibration)


FORMAT = LogFormat(
    "SPEED images", "a folder with images and test.json", _recognises, _open, takes_calibration=True
)
