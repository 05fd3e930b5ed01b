# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reading of files of poses, which are distinguished by content, and such a file as a log."""

from __future__ import annotations

import csv
import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cdff_common.formats.file_source import Source, load
from cdff_common.formats.tum import read_tum
from cdff_common.geometry import se3
from cdff_dev.logs.file_stamps import PERIOD_NS, file_stamps
from cdff_dev.logs.formats.images.truth import table_poses, truth_names
from cdff_dev.logs.formats.poses.csv_poses import is_pose_csv, read_pose_csv
from cdff_dev.logs.image_streams import pose_stream
from cdff_dev.logs.indexed import IndexedLog

_ROBOT, _CAMERA = "robot", "camera"
_Poses = tuple[NDArray[np.int64], NDArray[np.float64]]
logger = logging.getLogger(__name__)

#: Columns of a table of poses whose times are those of images.
_IMAGE_COLUMNS = ("image", "frame")


def pose_format(source: Source) -> str | None:
    """Return the format of a file of poses by its first lines; None for another file.

    ``csv``: named columns with times (EuRoC). ``images``: named columns with images instead of times.
    ``tum``: 8 numbers per line. ``kitti``: 12 numbers per line, rows of ``T (3, 4)``.
    """
    if is_pose_csv(source):
        return "csv"
    text = source.data[: 1 << 16].decode("ascii", "replace")
    header = text.splitlines()[0].split(",") if text.strip() else []
    if header and header[0] in _IMAGE_COLUMNS and ({"T00", "T23"} <= set(header) or "qw" in header):
        return "images"
    row = first_numbers(source)
    if len(row) == 8 and abs(np.linalg.norm(row[4:]) - 1.0) < 0.01:
        return "tum"
    if len(row) == 12 and _is_rotation(np.array(row).reshape(3, 4)[:, :3]):
        return "kitti"
    return None


def first_numbers(source: Source) -> list[float]:
    """Return the numbers in the first line that is not a comment; none if it has other words."""
    try:
        for line in source.data[: 1 << 16].decode("ascii").splitlines():
            words = line.split("#")[0].replace(",", " ").split()
            if words:
                return [float(word) for word in words]
    except ValueError:  # not text, or not numbers
        return []
    return []


def read_poses(source: Source) -> _Poses:
    """Read stamps ``(n,)`` in nanoseconds, in the order of the file, and matrices ``(n, 4, 4)``.

    Poses without times are 100 ms apart, or have those of the names of their images (see ``file_stamps``).

    Raises
    ------
    CodecError
        With the file name, if it is no file of poses, or a line is malformed.
    """
    chosen = pose_format(source)
    if chosen is None:
        raise source.error("no poses; expected TUM, KITTI or named columns")
    readers: dict[str, Callable[[Source], _Poses]] = {
        "csv": read_pose_csv,
        "images": _of_images,
        "tum": read_tum,
        "kitti": _kitti,
    }
    return readers[chosen](source)


def poses_log(path: Path) -> IndexedLog:
    """Open a file of poses as the stream ``/robot/truth.pose``; stamps are rounded to microseconds.

    Those of a table of true poses of images have the names that they have in the folder of the images.
    """
    source = load(path)
    stamps_ns, T = read_poses(source)
    stamps_ns = np.round(stamps_ns / 1000).astype(np.int64) * 1000
    name, parent, child = f"/{_ROBOT}/truth.pose", f"{_ROBOT}/world", f"{_ROBOT}/body"
    if pose_format(source) == "images":
        name, parent, child = truth_names(_ROBOT, path, _CAMERA)
    return IndexedLog({name: pose_stream(name, T, stamps_ns, parent=parent, child=child)})


def _of_images(source: Source) -> _Poses:
    """Return the poses of a table with one image per row; stamps come from the names of the images."""
    rows = list(csv.DictReader(source.data.decode("utf-8", "replace").splitlines()))
    try:
        names = [Path(row.get("image") or row["frame"]) for row in rows]
        T = table_poses(rows)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise source.error(
            f"{type(error).__name__} {error}; expected image or frame, and T00 to T23 or qw … tz_m"
        ) from error
    return file_stamps(names), T


def _kitti(source: Source) -> _Poses:
    """Return the poses of a KITTI file, 100 ms apart; raises CodecError."""
    try:
        table = np.array(_kitti_rows(source), dtype=np.float64).reshape(-1, 12)
        if not np.isfinite(table).all():
            raise ValueError("numbers that are not finite")
    except ValueError as error:
        raise source.error(f"{error}; expected 12 numbers per line: the upper rows of a 4x4 pose") from error
    rows = table.reshape(-1, 3, 4)
    R = se3.normalise_rotation(rows[:, :, :3])
    if np.abs(R - rows[:, :, :3]).max() > 1e-2:
        raise source.error("a 3x3 block differs by more than 0.01 from a rotation")
    return np.arange(len(rows), dtype=np.int64) * PERIOD_NS, se3.transform(R, rows[:, :, 3])


def _kitti_rows(source: Source) -> list[list[float]]:
    """Return the numbers of each line; the line in which a file was cut is left out with a warning."""
    lines = [line.split("#")[0].split() for line in source.data.decode().splitlines()]
    rows = [(number, words) for number, words in enumerate(lines, start=1) if words]
    if len(rows) > 1 and len(rows[-1][1]) < 12 and not source.data.endswith(b"\n"):
        number, words = rows.pop()
        logger.warning("%s: ends in line %d with %d of 12 numbers", source.name, number, len(words))
    if wrong := next(((number, words) for number, words in rows if len(words) != 12), None):
        raise ValueError(f"line {wrong[0]}: {len(wrong[1])} numbers")
    return [[float(word) for word in words] for _, words in rows]


def _is_rotation(R: NDArray[np.float64]) -> bool:
    return bool(np.isfinite(R).all() and np.abs(se3.normalise_rotation(R) - R).max() < 1e-2)
