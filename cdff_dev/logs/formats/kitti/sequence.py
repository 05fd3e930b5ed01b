# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""KITTI odometry folders as logs: rectified grey pairs, Velodyne scans and true poses, if available.

Geiger, A., Lenz, P., Urtasun, R. (2012). Are we ready for autonomous driving? The KITTI vision benchmark
suite. CVPR. doi:10.1109/CVPR.2012.6248074
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from cdff_common.camera import StereoCalibration, check_image_size, read_camera, read_stereo
from cdff_common.contract.foreign_names import MOUNT_PORT
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import LidarScan
from cdff_dev.logs.formats.kitti.velodyne import read_scan, scan_files
from cdff_dev.logs.image_streams import Stamps, frame_stream, pair_stream, pose_stream, read_image
from cdff_dev.logs.indexed import IndexedLog, IndexedStream, headers
from cdff_dev.logs.other_files import other_files
from cdff_dev.logs.source import Unconverted

ROBOT = "kitti"
PAIR, SCAN, TRUTH = (f"/{ROBOT}/{name}" for name in ("navcam.pair", "lidar.scan", "truth.pose"))
MOUNT = f"/{ROBOT}/lidar.{MOUNT_PORT}"
_CAMERA, _LIDAR, _START = (f"{ROBOT}/{name}" for name in ("navcam_left", "lidar", "vo"))
#: Left and right image folders: the benchmark's grey and colour ones, and those of extracts.
_IMAGE_FOLDERS = (
    ("image_0", "image_1"),
    ("image_2", "image_3"),
    ("image_l", "image_r"),
    ("image_l_kitti", "image_r_kitti"),
)
_COLOUR_FOLDERS = _IMAGE_FOLDERS[1]
#: Largest offset of the right camera along y or z relative to its offset along x. In the colour cameras of
#: the benchmark, whose images are rectified again, the ratio is 0.5 %.
_MAX_OFFSET = 0.02
#: Row of the pose of the lidar in the left grey camera.
_LIDAR_ROW = "Tr"
#: Rows of the projections of the colour cameras, if the calibration has them.
_COLOUR_CAMERAS = ("P2", "P3")
#: Calibration files, in order of precedence: in an extract with ``calib_kitti.txt``, ``calib.txt`` may
#: belong to another camera.
_CALIBRATIONS = ("calib_kitti.txt", "calib.txt")
#: Period of the images without ``times.txt``.
_PERIOD_US = 100_000


def is_kitti(folder: Path) -> bool:
    """Return whether a folder contains folders of left and right images, or of Velodyne scans."""
    return _has_images(folder) or bool(scan_files(folder))


def kitti_log(folder: Path, calibration: Path | None = None) -> IndexedLog:
    """Open a KITTI sequence; raises InputError if its files are inconsistent.

    Streams, each if its files exist, are ``/kitti/navcam.pair`` (FramePair) of the images, grey ones if both
    exist, then with the colour images as ``/kitti/colour_left.frame`` and ``/kitti/colour_right.frame``,
    ``/kitti/lidar.scan`` (LidarScan) of ``velodyne/NNNNNN.bin`` in the frame ``kitti/lidar``,
    ``/kitti/lidar.mount`` with its pose in the left camera if the calibration has one (``Tr``), and
    ``/kitti/truth.pose`` of ``poses.txt`` or ``poses/NN.txt``: the pose of the left camera
    (``kitti/navcam_left``) in its first pose (``kitti/vo``). Stamps are those of ``times.txt``; without it
    they are multiples of 100 ms from 0.

    Parameters
    ----------
    folder : Path
    calibration : Path, optional
        Calibration of the stereo camera; by default ``calib_kitti.txt``, else ``calib.txt``.
    """
    scans = scan_files(folder)
    pairs = _images(folder) if _has_images(folder) or not scans else []
    if not pairs and calibration is not None:
        raise InputError(f"{folder}: no images for the calibration {calibration}")
    n = max(len(pairs), *(number + 1 for number in scans), 0)
    stamps_ns = _stamps(folder, n)
    streams: dict[str, IndexedStream] = {}
    if pairs:
        stereo = _calibration(folder, calibration, pairs[0][0])
        streams[PAIR] = pair_stream(PAIR, pairs, stamps_ns[: len(pairs)], stereo)
        if pairs[0][0].parent.name == _IMAGE_FOLDERS[0][0]:
            streams |= _colour_streams(folder, calibration, stamps_ns)
    if scans:
        streams[SCAN] = scan_stream(list(scans.values()), stamps_ns[list(scans)])
        if (T_camera_lidar := _pose_of_lidar(folder)) is not None:
            streams[MOUNT] = mount_stream(T_camera_lidar, stamps_ns[min(scans)], _CAMERA)
    if (truth := _truth(folder, len(pairs) or n)) is not None:
        streams[TRUTH] = pose_stream(TRUTH, truth, stamps_ns[: len(truth)], parent=_START, child=_CAMERA)
    return IndexedLog(streams, _unused_files(folder, calibration, pairs, scans))


def _unused_files(
    folder: Path, calibration: Path | None, pairs: list[tuple[Path, Path]], scans: dict[int, Path]
) -> dict[str, Unconverted]:
    """Return the files that are not part of a stream, nor its times or calibration."""
    used_files = {
        folder / "times.txt",
        _poses_file(folder),
        *scans.values(),
        *(file for pair in pairs for file in pair),
    }
    if pairs:
        used_files.add(_calibration_file(folder, calibration))
    if scans:
        used_files.add(folder / _CALIBRATIONS[-1])
    if pairs and pairs[0][0].parent.name == _IMAGE_FOLDERS[0][0]:
        used_files.update(file for name in _COLOUR_FOLDERS for file in (folder / name).glob("*.png"))
    reason = "not an image, a scan, their calibration, times.txt or poses of the sequence"
    return other_files(folder, used_files.__contains__, reason)


def scan_stream(files: list[Path], stamps_ns: Stamps) -> IndexedStream:
    """Return the stream of Velodyne scans."""

    def read(i: int) -> LidarScan:
        return read_scan(files[i], _LIDAR, int(stamps_ns[i]))

    return IndexedStream(
        "LidarScan", stamps_ns, read, headers(SCAN, stamps_ns, frame=_LIDAR, producer=_LIDAR)
    )


def mount_stream(T_parent_lidar: FloatArray, stamp_ns: int, parent: str) -> IndexedStream:
    """Return the stream with the pose of the lidar on the robot or on a camera."""
    return pose_stream(
        MOUNT, T_parent_lidar[None], np.array([stamp_ns], np.int64), parent=parent, child=_LIDAR
    )


def _pose_of_lidar(folder: Path) -> FloatArray | None:
    """Return the pose of the lidar in the left grey camera, the row ``Tr`` of the calibration, if any."""
    path = folder / _CALIBRATIONS[-1]
    if not path.is_file() or not _has_rows(path, [_LIDAR_ROW]):
        return None
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    words = next(line for line in lines if line.partition(":")[0].strip() == _LIDAR_ROW).split(":")[1].split()
    try:
        upper = np.array(words, np.float64).reshape(3, 4)
        if not np.all(np.isfinite(upper)):
            raise ValueError(f"{' '.join(words)} is not finite")
        return np.asarray(se3.transform(se3.normalise_rotation(upper[:, :3]), upper[:, 3]), np.float64)
    except ValueError as error:
        raise InputError(f"{path}: {_LIDAR_ROW}: {error}; expected the 12 numbers of a pose") from error


def _has_images(folder: Path) -> bool:
    return any((folder / left).is_dir() and (folder / right).is_dir() for left, right in _IMAGE_FOLDERS)


def _images(folder: Path) -> list[tuple[Path, Path]]:
    """Return the files of the left and right images."""
    for left_name, right_name in _IMAGE_FOLDERS:
        left, right = sorted((folder / left_name).glob("*.png")), sorted((folder / right_name).glob("*.png"))
        if left and [p.name for p in left] == [p.name for p in right]:
            return list(zip(left, right, strict=True))
        if left or right:
            raise InputError(
                f"{folder}: {len(left)} images in {left_name}, {len(right)} in {right_name}: expected images "
                "with equal names"
            )
    known = " or ".join(f"{a} and {b}" for a, b in _IMAGE_FOLDERS)
    raise InputError(f"{folder}: expected a KITTI sequence with images in {known}, or with velodyne/*.bin")


def _rows(path: Path, columns: int) -> FloatArray:
    """Return the numbers ``(n, columns)`` of a text file, without a label before a colon in a line."""
    rows = []
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        words = line.split(":")[-1].split()
        try:
            values = [float(word) for word in words]
        except ValueError as error:
            raise InputError(f"{path}:{number}: {error}") from error
        if not all(map(math.isfinite, values)):
            raise InputError(f"{path}:{number}: {' '.join(words)}: expected finite numbers")
        if len(values) == columns:
            rows.append(values)
        elif values:
            raise InputError(f"{path}:{number}: {len(values)} numbers, expected {columns}")
    if not rows:
        raise InputError(f"{path}: expected lines of {columns} numbers")
    return np.array(rows)


def _calibration(folder: Path, chosen: Path | None, image: Path) -> StereoCalibration:
    """Return the calibration of the cameras; raises InputError if it is missing or not of a rectified pair.

    For images of the colour cameras these are ``P2`` and ``P3``, otherwise the first two cameras of the
    file. The file is ``chosen`` or, by default, that of the folder.
    """
    path = _calibration_file(folder, chosen)
    is_colour = image.parent.name == "image_2" and _has_rows(path, _COLOUR_CAMERAS)
    calibration = read_stereo(path, *_COLOUR_CAMERAS) if is_colour else read_stereo(path)
    x_m, *others_m = calibration.T_right_left[:3, 3]
    if x_m >= 0 or np.abs(others_m).max() > _MAX_OFFSET * -x_m:
        raise InputError(
            f"{path}: expected a rectified pair with the right camera to the right of the left camera"
        )
    rows, cols = read_image(image).shape[:2]
    check_image_size(calibration.left, rows, cols, str(path))
    return with_size(calibration, image)


def with_size(calibration: StereoCalibration, image: Path) -> StereoCalibration:
    """Return the calibration; if it contains no image size, the cameras get the size of an image."""
    if calibration.left.rows:
        return calibration
    rows, cols = read_image(image).shape[:2]
    left, right = (replace(c, rows=rows, cols=cols) for c in (calibration.left, calibration.right))
    return replace(calibration, left=left, right=right)


def _colour_streams(folder: Path, calibration: Path | None, stamps_ns: Stamps) -> dict[str, IndexedStream]:
    """Return the streams of the colour cameras of a folder whose pairs are grey."""
    streams = {}
    for name, side, row in zip(_COLOUR_FOLDERS, ("left", "right"), _COLOUR_CAMERAS, strict=True):
        if files := sorted((folder / name).glob("*.png")):
            stream = f"/{ROBOT}/colour_{side}.frame"
            path = _calibration_file(folder, calibration)
            camera = read_camera(path, row) if _has_rows(path, [row]) else None
            if len(files) > len(stamps_ns):
                raise InputError(f"{folder / name}: {len(files)} images, {len(stamps_ns)} grey pairs")
            streams[stream] = frame_stream(stream, files, stamps_ns[: len(files)], camera)
    return streams


def _calibration_file(folder: Path, chosen: Path | None) -> Path:
    files = [folder / name for name in _CALIBRATIONS] if chosen is None else [chosen]
    path = next((file for file in files if file.is_file()), None)
    if path is None:
        raise InputError(
            f"{folder}: {' or '.join(map(str, files))} not found; name the file with --calibration"
        )
    return path


def _has_rows(path: Path, names: Collection[str]) -> bool:
    """Return whether a calibration file has rows of all names."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    return set(names) <= {line.partition(":")[0].strip() for line in lines}


def _stamps(folder: Path, n: int) -> Stamps:
    """Return the times of ``times.txt`` (at least n), or n multiples of 100 ms without it, nanoseconds."""
    path = folder / "times.txt"
    if not path.is_file():
        return np.arange(n, dtype=np.int64) * (_PERIOD_US * 1000)
    times_s = _rows(path, 1)[:, 0]
    if len(times_s) < n or np.any(np.diff(times_s[:n]) <= 0):
        raise InputError(
            f"{path}: {len(times_s)} times for {n} images or scans, expected one each, ascending"
        )
    return np.round(times_s[:n] * 1e6).astype(np.int64) * 1000


def _poses_file(folder: Path) -> Path | None:
    """Return ``poses.txt``, else ``poses/NN.txt`` in the folder or next to the folder ``sequences``; None
    without one.
    """
    name = f"{folder.resolve().name}.txt"
    numbered_files = sorted((folder / "poses").glob("[0-9][0-9].txt"))
    benchmark = folder.resolve().parents[1] / "poses" / name if len(folder.resolve().parents) > 1 else folder
    candidates = [
        folder / "poses.txt",
        folder / "poses" / name,
        *(numbered_files if len(numbered_files) == 1 else []),
        benchmark,
    ]
    return next((path for path in candidates if path.is_file()), None)


def _truth(folder: Path, n: int) -> FloatArray | None:
    """Return the first n true poses (n, 4, 4); None without a file of poses."""
    path = _poses_file(folder)
    if path is None:
        return None
    rows = _rows(path, 12).reshape(-1, 3, 4)
    if len(rows) < n:
        raise InputError(f"{path}: {len(rows)} poses for {n} images or scans")
    return se3.transform(se3.normalise_rotation(rows[:n, :, :3]), rows[:n, :, 3])
