# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Opens whatever ``LOG`` means on the command line."""

from __future__ import annotations

import glob
from pathlib import Path

from cdff_common.errors import InputError
from cdff_dev.logs.reader import LogReader
from cdff_dev.logs.source import LogSource


def open_log(path: str | Path) -> LogSource:
    """Open a log.

    Parameters
    ----------
    path : str or Path
        One ``.msg`` file, a folder of them, a pattern as ``run_*.msg``, ``NAME.msg`` of a log that was written as
        ``NAME_000000000.msg``, …, or a folder of the KITTI odometry layout.

    Raises
    ------
    InputError
        If there is no log.
    """
    where = Path(path)
    if where.is_dir():
        from cdff_dev.convert.kitti import is_kitti, open_kitti

        if is_kitti(where):
            return open_kitti(where)
        files = sorted(where.glob("*.msg"))
    elif where.is_file():
        files = [where]
    elif any(c in str(path) for c in "*?["):
        files = [Path(p) for p in sorted(glob.glob(str(path)))]  # noqa: PTH207  # the pattern may hold folders
    else:
        chunks = f"{glob.escape(where.stem)}_{'[0-9]' * 9}.msg"
        files = sorted(where.parent.glob(chunks)) if where.suffix == ".msg" else []
    if not files:
        raise InputError(f"log {path}: no such file, folder of .msg files or pattern that matches any")
    return LogReader(files)
