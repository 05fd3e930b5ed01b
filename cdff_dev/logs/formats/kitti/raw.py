# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""KITTI raw recordings as logs: a drive with ``image_00`` to ``image_03``, ``velodyne_points`` and ``oxts``.

Geiger, A., Lenz, P., Stiller, C., Urtasun, R. (2013). Vision meets robotics: the KITTI dataset. IJRR 32(11).
doi:10.1177/0278364913491297
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from cdff_common.camera import read_camera, read_stereo
from cdff_common.clock import MAX_STAMP_NS
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs.formats.kitti.oxts import imu_stream, truth_stream
from cdff_dev.logs.formats.kitti.sequence import (
    MOUNT,
    PAIR,
    ROBOT,
    SCAN,
    TRUTH,
    mount_stream,
    scan_stream,
    with_size,
)
from cdff_dev.logs.image_streams import Stamps, frame_stream, pair_stream
from cdff_dev.logs.indexed import IndexedLog, IndexedStream
from cdff_dev.logs.other_files import other_files
from cdff_dev.logs.source import Unconverted

_IMU = f"/{ROBOT}/imu.imu"
_WORLD, _BODY = f"{ROBOT}/world", f"{ROBOT}/base"
_GREY, _COLOUR = ("image_00", "image_01"), ("image_02", "image_03")
_STREAMS = (*_GREY, *_COLOUR, "velodyne_points", "oxts")
_CALIBRATION = "calib_cam_to_cam.txt"
#: Calibrations that lead from the navigation system to camera 0.
_BODY_CALIBRATIONS = ("calib_imu_to_velo.txt", "calib_velo_to_cam.txt")
Files = dict[str, tuple[Path, int]]


def is_raw(folder: Path) -> bool:
    """Return True if a folder contains a sensor's folder with ``data``."""
    return any((folder / name / "data").is_dir() for name in _STREAMS)


def raw_log(folder: Path, calibration: Path | None = None) -> IndexedLog:
    """Open a drive; raises InputError if its files are inconsistent.

    Streams, each if its files exist, are ``/kitti/navcam.pair`` of the grey cameras, or of the colour cameras
    if there are no grey ones, otherwise ``/kitti/colour_left.frame`` and ``/kitti/colour_right.frame``;
    ``/kitti/lidar.scan``, with its pose in ``kitti/base`` as ``/kitti/lidar.mount``; ``/kitti/imu.imu`` and
    ``/kitti/truth.pose`` of ``oxts``: the navigation system (``kitti/base``) in east, north, up
    (``kitti/world``). Times are those of ``timestamps.txt``, taken as
    UTC.

    Parameters
    ----------
    folder : Path
    calibration : Path, optional
        Calibration of the cameras; by default ``calib_cam_to_cam.txt`` of the folder or of its parent. The
        other calibrations next to it give the pose of the cameras in ``kitti/base``.
    """
    files = {name: _files(folder / name) for name in _STREAMS}
    streams: dict[str, IndexedStream] = {}
    unconverted: dict[str, Unconverted] = {}
    if any(files[name] for name in (*_GREY, *_COLOUR)):
        path = calibration or _calibration_file(folder)
        _add_cameras(streams, unconverted, files, path)
    elif calibration is not None:
        raise InputError(f"{folder}: no images for the calibration {calibration}")
    if files["velodyne_points"]:
        paths, stamps_ns = _paths_and_stamps(files["velodyne_points"])
        streams[SCAN] = scan_stream(paths, stamps_ns)
        if (T_lidar_body := _pose_of_body_in_lidar(folder)) is not None:
            streams[MOUNT] = mount_stream(se3.inverse(T_lidar_body), int(stamps_ns[0]), _BODY)
    if files["oxts"]:
        paths, stamps_ns = _paths_and_stamps(files["oxts"])
        streams[_IMU] = imu_stream(_IMU, paths, stamps_ns, _BODY)
        streams[TRUTH] = truth_stream(TRUTH, paths, stamps_ns, _WORLD, _BODY)
    if not streams:
        raise InputError(f"{folder}: no files in {', '.join(f'{name}/data' for name in _STREAMS)}")
    used_files = {path for files_of_sensor in files.values() for path, _ in files_of_sensor.values()}
    used_files |= {folder / name / "timestamps.txt" for name in _STREAMS}
    used_files |= {folder / name for name in (_CALIBRATION, *_BODY_CALIBRATIONS)}
    reason = "not a file of a sensor, its times or a calibration"
    others = other_files(folder, used_files.__contains__, reason, ("*", "*/*", "*/*/*"))
    return IndexedLog(streams, unconverted | others)


def _add_cameras(
    streams: dict[str, IndexedStream],
    unconverted: dict[str, Unconverted],
    files: dict[str, Files],
    path: Path,
) -> None:
    """Add the stream of pairs, and those of the colour images if the pairs are grey."""
    T_camera_body = _pose_of_body(path)
    names = _GREY if files[_GREY[0]] and files[_GREY[1]] else _COLOUR
    left, right = files[names[0]], files[names[1]]
    common = sorted(left.keys() & right.keys())
    if single := len(left) + len(right) - 2 * len(common):
        unconverted[f"single images of {names[0]}"] = Unconverted(
            "image", single, "the other camera's image is missing"
        )
    if common:
        stereo = with_size(
            read_stereo(path, *(_rectified_camera(name) for name in names)), left[common[0]][0]
        )
        T_robot_left = None
        if T_camera_body is not None:
            offset_m = _offset_m(path, _rectified_camera(names[0]))
            T_left_body = se3.transform(np.eye(3), offset_m) @ T_camera_body
            T_robot_left = UncertainTransform.exact(se3.inverse(T_left_body))
        stamps_ns = _ascending([left[number] for number in common])
        pairs = [(left[number][0], right[number][0]) for number in common]
        streams[PAIR] = pair_stream(PAIR, pairs, stamps_ns, stereo, T_robot_left)
    for name, side in zip(_COLOUR, ("left", "right"), strict=True):
        if names is _GREY and files[name]:
            stream = f"/{ROBOT}/colour_{side}.frame"
            paths, stamps_ns = _paths_and_stamps(files[name])
            streams[stream] = frame_stream(
                stream, paths, stamps_ns, read_camera(path, _rectified_camera(name))
            )


def _rectified_camera(name: str) -> str:
    """Return the camera of a folder in the calibration: ``rect_00`` of ``image_00``."""
    return name.replace("image", "rect")


def _calibration_file(folder: Path) -> Path:
    candidates = [place / _CALIBRATION for place in (folder, folder.resolve().parent)]
    calibration_path = next((path for path in candidates if path.is_file()), None)
    if calibration_path is None:
        raise InputError(
            f"{folder}: {_CALIBRATION} not found there or in its parent; name the file with --calibration"
        )
    return calibration_path


def _files(folder: Path) -> Files:
    """Return the files of a sensor with their stamps, by name.

    The number in the name of a file is the line of its time in ``timestamps.txt``.

    Raises
    ------
    InputError
        If a file has no time.
    """
    data = folder / "data"
    paths = sorted(path for path in data.iterdir() if path.stem.isdigit()) if data.is_dir() else []
    if not paths:
        return {}
    table = folder / "timestamps.txt"
    try:
        lines = table.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise InputError(
            f"{table}: cannot be read: {error.strerror}; expected a time for each file"
        ) from error
    stamped_files: Files = {}
    for path in paths:
        number = int(path.stem)
        if number >= len(lines):
            raise InputError(f"{table}: {len(lines)} times, expected one for {path.name}")
        stamped_files[path.stem] = (path, _stamp_ns(table, number, lines[number]))
    return stamped_files


def _stamp_ns(table: Path, number: int, line: str) -> int:
    """Return the stamp of ``2011-09-26 13:02:25.964389445``, in whole microseconds."""
    seconds, _, fraction = line.strip().partition(".")
    try:
        start = datetime.strptime(seconds, "%Y-%m-%d %H:%M:%S").replace(tzinfo=UTC)
        nanoseconds = int(fraction.ljust(9, "0")[:9] or "0")
    except ValueError as error:
        raise InputError(f"{table}:{number + 1}: {error}; expected 2011-09-26 13:02:25.964389445") from error
    stamp_ns = (int(start.timestamp()) * 1_000_000_000 + nanoseconds + 500) // 1000 * 1000
    if abs(stamp_ns) > MAX_STAMP_NS:
        raise InputError(f"{table}:{number + 1}: {seconds}: expected a time before the year 2262")
    return stamp_ns


def _paths_and_stamps(files: Files) -> tuple[list[Path], Stamps]:
    """Return the paths of the files and their stamps, in order."""
    return [path for path, _ in files.values()], _ascending(list(files.values()))


def _ascending(files: Sequence[tuple[Path, int]]) -> Stamps:
    """Return the stamps of files; raises InputError if they do not ascend."""
    stamps_ns = np.array([stamp for _, stamp in files], np.int64)
    if np.any(np.diff(stamps_ns) <= 0):
        path = files[int(np.argmax(np.diff(stamps_ns) <= 0)) + 1][0]
        raise InputError(f"{path}: its time in timestamps.txt is not after that of the previous file")
    return stamps_ns


def _pose_of_body_in_lidar(folder: Path) -> FloatArray | None:
    """Return the pose of the navigation system in the lidar; None without its calibration."""
    places = [place / _BODY_CALIBRATIONS[0] for place in (folder, folder.resolve().parent)]
    path = next((path for path in places if path.is_file()), None)
    return None if path is None else _pose(path)


def _pose(path: Path) -> FloatArray:
    rows = _rows(path)
    if not {"R", "T"} <= rows.keys() or len(rows["R"]) != 9 or len(rows["T"]) != 3:
        raise InputError(f"{path}: expected lines R (9 numbers) and T (3 numbers)")
    if not (np.isfinite(rows["R"]).all() and np.isfinite(rows["T"]).all()):
        raise InputError(f"{path}: expected finite numbers in R and T")
    return np.asarray(se3.transform(se3.normalise_rotation(rows["R"].reshape(3, 3)), rows["T"]), np.float64)


def _pose_of_body(calibration: Path) -> FloatArray | None:
    """Return the pose of the navigation system in the rectified camera 0; None without its calibrations."""
    paths = [calibration.parent / name for name in _BODY_CALIBRATIONS]
    if not all(path.is_file() for path in paths):
        return None
    T = np.eye(4)
    for path in paths:
        T = _pose(path) @ T
    R_rect = _rows(calibration).get("R_rect_00", np.eye(3).ravel())
    if len(R_rect) != 9:
        raise InputError(f"{calibration}: R_rect_00 of {len(R_rect)} numbers, expected 9")
    return np.asarray(se3.transform(se3.normalise_rotation(R_rect.reshape(3, 3)), np.zeros(3)) @ T)


def _offset_m(calibration: Path, camera: str) -> FloatArray:
    """Return the position of camera 0 in the frame of a rectified camera, of its projection matrix."""
    P = _rows(calibration).get(f"P_{camera}", np.zeros(0))
    if len(P) != 12:
        return np.zeros(3)
    return np.asarray(np.linalg.solve(P.reshape(3, 4)[:, :3], P.reshape(3, 4)[:, 3]), np.float64)


def _rows(path: Path) -> dict[str, FloatArray]:
    """Return the numbers of each line ``name: numbers``; lines of other content are left out."""
    rows = {}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        name, _, numbers = line.partition(":")
        try:
            rows[name.strip()] = np.array(numbers.split(), np.float64)
        except ValueError:  # the date of the calibration
            continue
    return rows
