# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""E57 files of laser scanners (ASTM E2807), read by pye57."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.errors import CodecError, InputError
from cdff_common.formats.cloud import CloudArrays

MAGIC = b"ASTM-E57"
#: A file of n bytes has at most 8 n points, each of at least one bit; more are refused.
_MAX_POINTS_PER_BYTE = 8
#: Largest number of points of a scan, whatever the size of the file.
_MAX_POINTS = 20_000_000


def read_e57(path: Path) -> CloudArrays:
    """Return the points of all scans of a file in its coordinate system.

    Raises
    ------
    InputError
        If pye57 is not installed.
    CodecError
        If the file cannot be read.
    """
    try:
        import pye57  # type: ignore[import-untyped]
        from pye57 import libe57
    except ImportError as error:
        raise InputError(
            f'{path}: E57 needs pye57: install the extra "logs", for example pip install "cdff[logs]"'
        ) from error
    try:
        with pye57.E57(str(path)) as file:
            _check_claim(path, file)
            scans = [
                file.read_scan(i, intensity=True, ignore_missing_fields=True) for i in range(file.scan_count)
            ]
    except (libe57.E57Exception, RuntimeError, ValueError, LookupError, TypeError, MemoryError) as error:
        raise CodecError(f"{path}: not a readable E57 file: {error}") from error
    if not scans:
        raise CodecError(f"{path}: an E57 file without scans")
    points_m = np.concatenate([np.stack([scan[f"cartesian{a}"] for a in "XYZ"], axis=1) for scan in scans])
    has_intensity = all("intensity" in scan for scan in scans)
    return CloudArrays.of(
        points_m, np.concatenate([scan["intensity"] for scan in scans]) if has_intensity else None
    )


def _check_claim(path: Path, file: Any) -> None:
    """Refuse more points than a file can hold, before memory is allocated."""
    size = path.stat().st_size
    points = sum(file.get_header(i).point_count for i in range(file.scan_count))
    limit = min(_MAX_POINTS_PER_BYTE * size, _MAX_POINTS)
    if points > limit:
        raise CodecError(f"{path}: {points} points in {size} bytes, expected at most {limit}")
