# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar scans as one file each: a folder or a pattern of files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.file_stamps import natural_order
from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.indexed import IndexedLog

_SUFFIXES = (".bin", ".ply", ".pcd", ".las", ".laz", ".npz", ".npy", ".e57")
#: Suffixes of clouds as text; ``.txt`` files are clouds if their first lines are points.
_TEXT_SUFFIXES = (".xyz", ".asc", ".pts", ".txt")
#: Number of bytes at the start of a text file that are read to recognise points.
_HEAD_BYTES = 4096


def _files(location: LogLocation) -> list[Path]:
    """Return the scans of a location, in natural order; all have the suffix of the first by name."""
    candidates = sorted(location.folder.iterdir()) if location.folder else list(location.files)
    candidates = [path for path in candidates if path.is_file()]
    scans = [path for path in candidates if path.suffix.lower() in _SUFFIXES]
    scans = scans or [path for path in candidates if _is_text_cloud(path)]
    return sorted((path for path in scans if path.suffix == scans[0].suffix), key=natural_order)


def _is_text_cloud(path: Path) -> bool:
    """Return whether a text file is a list of points, and not the matrix of a transform."""
    if path.suffix.lower() not in _TEXT_SUFFIXES:
        return False
    from cdff_common.formats.xyz import looks_like_xyz

    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if len(head) < _HEAD_BYTES and _is_matrix(head):
        return False
    return looks_like_xyz(head if len(head) == _HEAD_BYTES else head + b"\n\n")


def _is_matrix(data: bytes) -> bool:
    """Return whether a text is the matrix of a transform: four lines, the last of which is 0 0 0 1."""
    rows = [line.split() for line in data.replace(b",", b" ").splitlines() if line.strip()]
    try:
        return len(rows) == 4 and [float(word) for word in rows[3]] == [0.0, 0.0, 0.0, 1.0]
    except ValueError:
        return False


def _is_bundle(path: Path) -> bool:
    """Return whether a ``.bin`` file is a bundle adjustment problem of libmv."""
    if path.suffix.lower() != ".bin":
        return False
    from cdff_common.formats.bundle_problem import looks_like_libmv

    with path.open("rb") as file:
        if file.read(1) not in (b"v", b"V"):  # a scan is not read whole for this
            return False
    return looks_like_libmv(path.read_bytes())


def _open(location: LogLocation, _: Path | None) -> IndexedLog:
    from cdff_dev.logs.formats.scans.scans import scans_log

    return scans_log(_files(location), location.folder)


def _recognises(location: LogLocation) -> bool:
    """A single cloud in a folder is more often the model of a map or an object than a recording."""
    files = _files(location)
    return len(files) >= (2 if location.folder else 1) and not _is_bundle(files[0])


FORMAT = LogFormat(
    "lidar scans", f"{', '.join((*_SUFFIXES, *_TEXT_SUFFIXES))} files", _recognises, _open, is_generic=True
)
