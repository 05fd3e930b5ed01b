# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Network captures of a Velodyne lidar."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_common.errors import InputError
from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.formats.pcap.capture import VelodyneLog

#: First bytes of pcap files of both byte orders, with times in microseconds or nanoseconds, and of pcapng.
_MAGIC = (
    b"\xd4\xc3\xb2\xa1",
    b"\xa1\xb2\xc3\xd4",
    b"\x4d\x3c\xb2\xa1",
    b"\xa1\xb2\x3c\x4d",
    b"\x0a\x0d\x0d\x0a",
)


def _recognises(location: LogLocation) -> bool:
    return location.head(4) in _MAGIC


def _open(location: LogLocation, _: Path | None) -> VelodyneLog:
    path = location.files[0]
    if len(location.files) > 1:
        raise InputError(f"{location.name}: {len(location.files)} captures; expected one")
    if location.head(4) == _MAGIC[-1]:
        raise InputError(
            f"{path}: a pcapng file; expected pcap: convert it with editcap -F pcap {path} OUT.pcap"
        )
    from cdff_dev.logs.formats.pcap.capture import VelodyneLog

    return VelodyneLog(path)


FORMAT = LogFormat("Velodyne capture", ".pcap files", _recognises, _open)
