# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of EuRoC as logs: stereo pairs or images, IMU and true poses.

Burri, M. et al. (2016). The EuRoC micro aerial vehicle datasets. IJRR 35(10). doi:10.1177/0278364915620033
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cdff_common.camera import CameraModel, StereoCalibration, read_cameras, read_stereo
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import IMUSensors, Time
from cdff_dev.logs.formats.euroc.pairs import BODY, PAIR, ROBOT, TRUTH, WORLD
from cdff_dev.logs.image_streams import Stamps, frame_stream, pair_stream, pose_stream
from cdff_dev.logs.indexed import IndexedLog, IndexedStream, headers
from cdff_dev.logs.other_files import other_files
from cdff_dev.logs.source import Unconverted
from cdff_dev.logs.tables import poses_of_rows, read_rows, read_table, read_times

_IMU = f"/{ROBOT}/imu.imu"
#: Times of EuRoC are in nanoseconds.
_NS = 1


def recording_log(folder: Path, calibration: Path | None = None, root: Path | None = None) -> IndexedLog:
    """Open a folder with ``cam0``, ``cam1``, ``imu0`` and ``state_groundtruth_estimate0``.

    Streams are ``/euroc/navcam.pair`` (rectified pairs of the common times of both cameras; with one camera
    ``/euroc/cam0.frame``), ``/euroc/imu.imu`` in the frame of the IMU, ``euroc/base``, and
    ``/euroc/truth.pose``. Other folders and files are listed as not converted, also those of ``root``, the
    folder around ``mav0``.

    Raises
    ------
    InputError
        If a table or a calibration cannot be read.
    """
    cameras = [path.parent for path in sorted(folder.glob("cam[0-9]/data.csv"))]
    streams, unconverted = _image_streams(cameras, calibration)
    if (table := folder / "imu0" / "data.csv").is_file():
        streams[_IMU] = _imu_stream(*read_table(table, 6, _NS))
    if (table := folder / "state_groundtruth_estimate0" / "data.csv").is_file():
        stamps_ns, rows = read_table(table, 7, _NS)
        T = poses_of_rows(table, rows, scalar_first=True)
        streams[TRUTH] = pose_stream(TRUTH, T, stamps_ns, parent=WORLD, child=BODY)
    known = {*(path.name for path in cameras), "imu0", "state_groundtruth_estimate0"}
    for path in sorted(folder.iterdir()):
        if path.is_dir() and path.name not in known:
            count = sum(1 for file in path.rglob("*") if file.is_file())
            reason = "in a folder other than cameras, imu0 or ground-truth state"
            unconverted[path.name] = Unconverted("file", count, reason)
    used_files = {path for camera in cameras for path in (*_images(camera).values(), camera / "sensor.yaml")}
    used_files |= {folder / name / "data.csv" for name in known} | {calibration or folder}
    inner = ["*", *(f"{name}/{pattern}" for name in known for pattern in ("*", "data/*"))]
    if root is not None and root != folder:
        inner = ["*", *(f"{folder.name}/{pattern}" for pattern in inner)]
    reason = "no image or table of the recording"
    others = other_files(root or folder, used_files.__contains__, reason, inner)
    return IndexedLog(streams, unconverted | others)


def _image_streams(
    cameras: list[Path], calibration: Path | None
) -> tuple[dict[str, IndexedStream], dict[str, Unconverted]]:
    """Return the stream of the pairs of the first two cameras, or of the images of the only one."""
    if not cameras:
        return {}, {}
    images = [_images(folder) for folder in cameras]
    unconverted = {
        folder.name: Unconverted("image", len(files), "a third camera")
        for folder, files in zip(cameras[2:], images[2:], strict=True)
    }
    if len(cameras) == 1:
        camera, T_body_camera = _camera(cameras[0], calibration)
        name = f"/{ROBOT}/{cameras[0].name}.frame"
        stamps_ns = np.array(sorted(images[0]), np.int64)
        files = [images[0][int(stamp)] for stamp in stamps_ns]
        place = UncertainTransform.exact(T_body_camera)
        return {name: frame_stream(name, files, stamps_ns, camera, place)}, unconverted
    common = sorted(images[0].keys() & images[1].keys())
    if not common:
        raise InputError(f"{cameras[0].parent}: cam0 and cam1 have no image of the same time")
    single = len(images[0]) + len(images[1]) - 2 * len(common)
    if single:
        unconverted["single images"] = Unconverted("image", single, "the other camera's image is missing")
    stereo, T_body_left = _stereo(cameras, calibration)
    pairs = [(images[0][stamp], images[1][stamp]) for stamp in common]
    place = UncertainTransform.exact(T_body_left)
    return {PAIR: pair_stream(PAIR, pairs, np.array(common, np.int64), stereo, place)}, unconverted


def _images(folder: Path) -> dict[int, Path]:
    """Return the files of a camera by stamp; raises InputError if one is missing."""
    table = folder / "data.csv"
    rows = read_rows(table, 2)
    stamps_ns = read_times(table, rows, _NS)
    files = {
        int(stamp): folder / "data" / words[1] for stamp, (_, words) in zip(stamps_ns, rows, strict=True)
    }
    missing = next((file for file in files.values() if not file.is_file()), None)
    if missing is not None:
        raise InputError(f"{table}: names {missing.name}, which is not in {missing.parent}")
    return files


def _camera(folder: Path, calibration: Path | None) -> tuple[CameraModel, FloatArray]:
    """Return a camera and its pose T_body_camera, of ``sensor.yaml`` or the first of the given file."""
    models, poses = read_cameras(calibration or folder / "sensor.yaml")
    name, camera = next(iter(models.items()))
    return camera, se3.inverse(poses[name]) if name in poses else np.eye(4)


def _stereo(folders: list[Path], calibration: Path | None) -> tuple[StereoCalibration, FloatArray]:
    """Return the calibration of the first two cameras, and the pose T_body_left."""
    if calibration is not None:
        return read_stereo(calibration), _camera(folders[0], calibration)[1]
    (left, T_body_left), (right, T_body_right) = (_camera(folder, None) for folder in folders[:2])
    T_right_left = se3.inverse(T_body_right) @ T_body_left
    return StereoCalibration.from_parts(left, right, T_right_left[:3, :3], T_right_left[:3, 3]), T_body_left


def _imu_stream(stamps_ns: Stamps, rows: FloatArray) -> IndexedStream:
    """Return the stream of rows of angular rates, rad/s, and specific forces, m/s2."""

    def read(i: int) -> IMUSensors:
        return IMUSensors(Time.from_ns(int(stamps_ns[i])), rows[i, 3:6], rows[i, :3], np.zeros(3))

    return IndexedStream("IMUSensors", stamps_ns, read, headers(_IMU, stamps_ns, frame=BODY))
