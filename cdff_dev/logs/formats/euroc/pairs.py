# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Folders of stereo pairs ``TIME_0.png`` and ``TIME_1.png`` (or JPEG) as a log.

The calibration ``calibration.yaml`` (Kalibr) and the true poses ``truth_{folder}.csv`` of the IMU (time in
nanoseconds, position, quaternion x, y, z, w) are in the folder or in its parent.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cdff_common.camera import read_cameras, read_stereo
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_dev.logs.formats.euroc import PAIR_NAME
from cdff_dev.logs.image_streams import pair_stream, pose_stream
from cdff_dev.logs.indexed import IndexedLog
from cdff_dev.logs.other_files import other_files
from cdff_dev.logs.source import Unconverted
from cdff_dev.logs.tables import poses_of_rows, read_table

ROBOT = "euroc"
PAIR, TRUTH = f"/{ROBOT}/navcam.pair", f"/{ROBOT}/truth.pose"
WORLD, BODY = f"{ROBOT}/world", f"{ROBOT}/base"
_CALIBRATION = "calibration.yaml"


def pairs_log(folders: list[Path], calibration: Path | None, root: Path) -> IndexedLog:
    """Open the pairs of all folders as ``/euroc/navcam.pair``, rectified, with the true poses, if available.

    ``root`` is the only folder, or the one around all of them; its other files are listed as not converted.

    Raises
    ------
    InputError
        If there is no calibration or no complete pair.
    """
    images = {
        (int(name_match[1]), name_match[2]): file
        for folder in folders
        for file in folder.iterdir()
        if (name_match := PAIR_NAME.match(file.name))
    }
    times = sorted({time for time, camera in images if (time, "0") in images and (time, "1") in images})
    if not times:
        raise InputError(f"{folders[0]}: images of one camera only, expected pairs TIME_0 and TIME_1")
    path = calibration or _nearest_image(folders[0], _CALIBRATION)
    if path is None:
        raise InputError(
            f"{folders[0]}: {_CALIBRATION} not found there or in its parent; name the file with --calibration"
        )
    stereo, (_, poses) = read_stereo(path), read_cameras(path)
    T_body_left = UncertainTransform.exact(se3.inverse(next(iter(poses.values()))))
    stamps_ns = (np.array(times, np.int64) + 500) // 1000 * 1000
    pairs = [(images[time, "0"], images[time, "1"]) for time in times]
    streams = {PAIR: pair_stream(PAIR, pairs, stamps_ns, stereo, T_body_left)}
    files = [file for folder in folders if (file := _nearest_image(folder, f"truth_{folder.name}.csv"))]
    if files:
        tables = [read_table(file, 7, unit_ns=1) for file in files]
        stamps_ns = np.concatenate([table[0] for table in tables])
        T = np.concatenate([poses_of_rows(file, table[1]) for file, table in zip(files, tables, strict=True)])
        order = np.argsort(stamps_ns, kind="stable")
        streams[TRUTH] = pose_stream(TRUTH, T[order], stamps_ns[order], parent=WORLD, child=BODY)
    single = len(images) - 2 * len(times)
    unconverted = {"single images": Unconverted("image", single, "the other camera's image is missing")}
    used_files = {*images.values(), *files, path}
    patterns = ("*", *(f"{folder.name}/*" for folder in folders if folder != root))
    others = other_files(root, used_files.__contains__, "not an image of a pair, nor their poses", patterns)
    return IndexedLog(streams, (unconverted if single else {}) | others)


def _nearest_image(folder: Path, name: str) -> Path | None:
    candidates = (folder / name, folder.resolve().parent / name)
    return next((path for path in candidates if path.is_file()), None)
