# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Detection of the format of a log, for the argument ``LOG`` of the commands."""

from __future__ import annotations

import glob
from pathlib import Path

from cdff_common.errors import InputError
from cdff_dev.logs.reader import LogReader
from cdff_dev.logs.source import LogSource
from cdff_dev.logs.writer import chunk_files


def open_log(path: str | Path, calibration: Path | None = None) -> LogSource:
    """Open a log of any format.

    Parameters
    ----------
    path : str or Path
        A ``.msg`` file, a folder of such files, a glob pattern such as ``run_*.msg``, the base name
        ``NAME.msg`` of a log split into ``NAME_000000000.msg``, ``NAME_000000001.msg``, …, or a folder in the
        KITTI odometry layout.
    calibration : Path, optional
        Calibration of the stereo camera of a KITTI folder.

    Raises
    ------
    InputError
        If no file matches, or a calibration is given for a log of another format.
    """
    where = Path(path)
    if where.is_dir():
        from cdff_dev.logs.kitti import KittiLog, is_kitti

        if is_kitti(where):
            return KittiLog(where, calibration)
        files = sorted(where.glob("*.msg"))
    elif where.is_file():
        files = [where]
    elif any(c in str(path) for c in "*?["):
        files = [Path(p) for p in sorted(glob.glob(str(path)))]  # noqa: PTH207
    else:
        files = chunk_files(where.parent, where.stem) if where.suffix == ".msg" else []
    if calibration is not None:
        raise InputError(f"log {path}: contains its own cameras; a calibration is for a KITTI folder")
    if not files:
        raise InputError(f"log {path}: no such file, folder of .msg files or pattern that matches any")
    return LogReader(files)
