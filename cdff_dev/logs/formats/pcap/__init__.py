# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Network captures of a Velodyne or an Ouster lidar."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_common.errors import InputError
from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.source import LogSource, Unconverted

_PCAP_MAGIC = (b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\xc3\xd4", b"\x4d\x3c\xb2\xa1", b"\xa1\xb2\x3c\x4d")
_PCAPNG_MAGIC = b"\x0a\x0d\x0d\x0a"
_SUFFIXES = (".pcap", ".pcapng")


def _captures(location: LogLocation) -> list[Path]:
    """Return the file at a location, or the captures in its folder."""
    if location.folder is None:
        return list(location.files)
    return sorted(file for file in location.folder.iterdir() if file.suffix.lower() in _SUFFIXES)


def _recognises(location: LogLocation) -> bool:
    """Return whether the first capture of a location begins like a PCAP or PCAPNG file."""
    captures = _captures(location)
    if not captures or not captures[0].is_file():
        return False
    with captures[0].open("rb") as file:
        return file.read(4) in (*_PCAP_MAGIC, _PCAPNG_MAGIC)


def _open(location: LogLocation, metadata: Path | None) -> LogSource:
    """Open a capture of an Ouster lidar if its metadata is found, otherwise of a Velodyne lidar."""
    captures = _captures(location)
    if len(captures) > 1:
        raise InputError(f"{location.name}: {len(captures)} captures; expected one: name it")
    path = captures[0]
    from cdff_dev.logs.formats.pcap.ouster_sensor import is_metadata

    if metadata is None:
        near = (path.with_suffix(".json"), *sorted(path.parent.glob(f"{path.stem}*.json")))
        metadata = next((file for file in near if is_metadata(file)), None)
    if metadata is None:
        in_folder = [file for file in sorted(path.parent.glob("*.json")) if is_metadata(file)]
        metadata = in_folder[0] if len(in_folder) == 1 else None
    if metadata is None:
        from cdff_dev.logs.formats.pcap.velodyne import VelodyneLog

        return VelodyneLog(path, _unused_files(location.folder, {path}))
    from cdff_dev.logs.formats.pcap.ouster import ouster_log

    return ouster_log(path, metadata, _unused_files(location.folder, {path, metadata}))


def _unused_files(folder: Path | None, used_files: set[Path]) -> dict[str, Unconverted]:
    """Return the other files of a folder; none if the capture was named itself."""
    if folder is None:
        return {}
    from cdff_dev.logs.other_files import other_files

    return other_files(folder, used_files.__contains__, "not the capture or its metadata")


FORMAT = LogFormat(
    "lidar capture",
    ".pcap files of a Velodyne, or of an Ouster with its metadata .json",
    _recognises,
    _open,
    takes_calibration=True,
)
