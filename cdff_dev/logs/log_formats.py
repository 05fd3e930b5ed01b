# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Opening of the logs that ``LOG`` may name on the command line."""

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
        A ``.msg`` file, a folder of such files, a glob pattern such as ``run_*.msg``, the base name
        ``NAME.msg`` of a log split into ``NAME_000000000.msg``, ``NAME_000000001.msg``, …, or a folder in the
        KITTI odometry layout.

    Raises
    ------
    InputError
        If there is no log.
    """
    where = Path(path)
    if where.is_dir():
        from cdff_dev.logs.kitti import KittiLog, is_kitti

        if is_kitti(where):
            return KittiLog(where)
        files = sorted(where.glob("*.msg"))
    elif where.is_file():
        files = [where]
    elif any(c in str(path) for c in "*?["):
        files = [Path(p) for p in sorted(glob.glob(str(path)))]  # noqa: PTH207
    else:
        chunks = f"{glob.escape(where.stem)}_{'[0-9]' * 9}.msg"
        files = sorted(where.parent.glob(chunks)) if where.suffix == ".msg" else []
    if not files:
        raise InputError(f"log {path}: no such file, folder of .msg files or pattern that matches any")
    return LogReader(files)
