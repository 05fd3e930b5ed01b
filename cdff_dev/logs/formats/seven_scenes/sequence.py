# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sequences of 7-Scenes as logs: colour images, depth images and true poses.

Shotton, J. et al. (2013). Scene coordinate regression forests for camera relocalization in RGB-D images.
CVPR. doi:10.1109/CVPR.2013.377
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cdff_common.camera import CameraModel
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs.file_stamps import PERIOD_NS
from cdff_dev.logs.formats.seven_scenes import COLOUR_NAME
from cdff_dev.logs.image_streams import Stamps, depth_stream, frame_stream, pose_stream
from cdff_dev.logs.indexed import IndexedLog, IndexedStream
from cdff_dev.logs.other_files import other_files
from cdff_dev.logs.tables import read_rows

ROBOT = "seven_scenes"
_COLOUR, _DEPTH, _TRUTH = (f"/{ROBOT}/{name}" for name in ("colour.frame", "depth.depth", "truth.pose"))
#: Nominal cameras of the Kinect; colour and depth are not registered.
_COLOUR_CAMERA = CameraModel(480, 640, 525.0, 525.0, 320.0, 240.0)
_DEPTH_CAMERA = CameraModel(480, 640, 585.0, 585.0, 320.0, 240.0)
#: Depth images contain millimetres; numbers of frames have at most six digits.
_DEPTH_UNIT_M = 1e-3
_MAX_DIGITS = 6
#: Folder of the images of an extract, and the table of poses next to it.
_EXTRACT, _TABLE = "frames", "truth.csv"


def sequence_log(frames: Path) -> IndexedLog:
    """Open the frames of a folder; frame n has the stamp n times 100 ms.

    Streams are ``/seven_scenes/colour.frame``, ``/seven_scenes/depth.depth`` and
    ``/seven_scenes/truth.pose``: the pose of the depth camera in ``seven_scenes/world``, of
    ``frame-NNNNNN.pose.txt`` or of ``truth.csv`` in the folder above.

    Raises
    ------
    InputError
        If a pose cannot be read.
    """
    colour = {
        int(name_match[1]): file
        for file in sorted(frames.iterdir())
        if (name_match := COLOUR_NAME.match(file.name))
    }
    depth = {n: path for n, file in colour.items() if (path := _beside(file, ".depth.png")).is_file()}
    streams: dict[str, IndexedStream] = {
        _COLOUR: frame_stream(_COLOUR, list(colour.values()), _stamps(list(colour)), _COLOUR_CAMERA)
    }
    if depth:
        streams[_DEPTH] = depth_stream(
            _DEPTH, list(depth.values()), _stamps(list(depth)), _DEPTH_CAMERA, _DEPTH_UNIT_M
        )
    if poses := _poses(frames, colour):
        T = np.array(list(poses.values()))
        streams[_TRUTH] = pose_stream(
            _TRUTH, T, _stamps(list(poses)), parent=f"{ROBOT}/world", child=f"{ROBOT}/depth"
        )
    used_files = {
        *colour.values(),
        *depth.values(),
        *(_beside(file, ".pose.txt") for file in colour.values()),
    }
    # The pictures of an extract have a folder of their own.
    folder = frames.parent if frames.name == _EXTRACT else frames
    used_files.add(folder / _TABLE)
    return IndexedLog(
        streams, other_files(folder, used_files.__contains__, "no part of a frame with a colour image")
    )


def _beside(colour: Path, suffix: str) -> Path:
    """Return another file of the same frame."""
    return colour.with_name(colour.name[: colour.name.index(".color.")] + suffix)


def _stamps(numbers: list[int]) -> Stamps:
    return np.array(numbers, np.int64) * PERIOD_NS


def _poses(frames: Path, colour: dict[int, Path]) -> dict[int, FloatArray]:
    """Return T_world_depth of each frame that has one."""
    files = {n: path for n, file in colour.items() if (path := _beside(file, ".pose.txt")).is_file()}
    if files:
        return {n: _pose(path, [words for _, words in read_rows(path, 4)][:3]) for n, path in files.items()}
    table = frames.parent / _TABLE
    if not table.is_file():
        return {}
    poses = {}
    for number, words in read_rows(table, 13):
        if not words[0].isdecimal() or len(words[0]) > _MAX_DIGITS:
            raise InputError(f"{table}:{number}: {words[0]!r}, expected the number of a frame")
        poses[int(words[0])] = _pose(table, [words[1:5], words[5:9], words[9:13]])
    return poses


def _pose(path: Path, rows: list[list[str]]) -> FloatArray:
    """Return a pose of the rows of its upper part; the rotations of the set are not quite orthogonal."""
    try:
        upper = np.array(rows, dtype=np.float64).reshape(3, 4)
    except ValueError as error:
        raise InputError(f"{path}: {error}; expected a 4x4 pose") from error
    if not np.isfinite(upper).all():
        raise InputError(f"{path}: a pose that is not finite")
    return se3.transform(se3.normalise_rotation(upper[:, :3]), upper[:, 3])
