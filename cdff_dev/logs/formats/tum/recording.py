# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of the TUM RGB-D benchmark as logs: colour and depth images, accelerations and true poses.

Sturm, J., Engelhard, N., Endres, F., Burgard, W., Cremers, D. (2012). A benchmark for the evaluation of RGB-D
SLAM systems. IROS. doi:10.1109/IROS.2012.6385773
"""

from __future__ import annotations

from pathlib import Path

from cdff_common.camera import CameraModel, read_camera
from cdff_common.errors import InputError
from cdff_dev.logs.image_streams import Stamps, depth_stream, frame_stream, pose_stream
from cdff_dev.logs.indexed import IndexedLog, IndexedStream
from cdff_dev.logs.other_files import other_files
from cdff_dev.logs.source import Unconverted
from cdff_dev.logs.tables import poses_of_rows, read_rows, read_table, read_times

ROBOT = "tum"
_COLOUR, _DEPTH, _TRUTH = (f"/{ROBOT}/{name}" for name in ("colour.frame", "depth.depth", "truth.pose"))
_SECOND_NS = 1_000_000_000
#: The depth images of the benchmark have 5000 for 1 m, and are registered to the colour images.
_DEPTH_UNIT_M = 1.0 / 5000.0
#: The camera that the benchmark recommends for registered images of a Kinect without a calibration.
_DEFAULT_CAMERA = CameraModel(480, 640, 525.0, 525.0, 319.5, 239.5)


def recording_log(folder: Path, calibration: Path | None = None) -> IndexedLog:
    """Open a recording.

    Streams, each if its table exists, are ``/tum/colour.frame`` (``rgb.txt``), ``/tum/depth.depth``
    (``depth.txt``) and ``/tum/truth.pose`` (``groundtruth.txt``): the pose of the colour camera in
    ``tum/world``. Without a calibration the cameras are the benchmark's default (525 px).

    Raises
    ------
    InputError
        If a table cannot be read or names an image that does not exist.
    """
    used_files = {folder / name for name in ("rgb.txt", "depth.txt", "groundtruth.txt", "accelerometer.txt")}
    camera = _DEFAULT_CAMERA if calibration is None else read_camera(calibration)
    streams: dict[str, IndexedStream] = {}
    if (table := folder / "rgb.txt").is_file():
        files, stamps_ns = _images(table)
        streams[_COLOUR] = frame_stream(_COLOUR, files, stamps_ns, camera)
        used_files.update(files)
    if (table := folder / "depth.txt").is_file():
        files, stamps_ns = _images(table)
        streams[_DEPTH] = depth_stream(_DEPTH, files, stamps_ns, camera, _DEPTH_UNIT_M)
        used_files.update(files)
    if (table := folder / "groundtruth.txt").is_file():
        stamps_ns, rows = read_table(table, 7, _SECOND_NS)
        T = poses_of_rows(table, rows)
        streams[_TRUTH] = pose_stream(_TRUTH, T, stamps_ns, parent=f"{ROBOT}/world", child=f"{ROBOT}/colour")
    if calibration is not None:
        used_files.add(calibration)
    unconverted = other_files(folder, used_files.__contains__, "not named in rgb.txt or depth.txt")
    if (table := folder / "accelerometer.txt").is_file():
        rows_without_rates = len(read_rows(table, 4))
        unconverted[table.name] = Unconverted(
            "acceleration", rows_without_rates, "no CDFF type has accelerations without angular rates"
        )
    return IndexedLog(streams, unconverted)


def _images(table: Path) -> tuple[list[Path], Stamps]:
    """Return files and stamps of a table of times and file names."""
    rows = read_rows(table, 2)
    files = [table.parent / words[1] for _, words in rows]
    for file, (number, words) in zip(files, rows, strict=True):
        if not file.is_file():
            raise InputError(f"{table}:{number}: {words[1]} does not exist")
    return files, read_times(table, rows, _SECOND_NS)
