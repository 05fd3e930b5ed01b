# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of a board with poses of a hand, scans of a lidar or readings of an IMU, from logs and folders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cdff_common.arrays import FloatArray
from cdff_common.camera import CameraModel, read_camera
from cdff_common.errors import InputError
from cdff_common.formats.tum import read_tum
from cdff_common.geometry import se3
from cdff_common.progress import Progress
from cdff_common.types import Frame
from cdff_core.calibration.adjustment import View
from cdff_core.calibration.board_poses import BoardPose, board_poses_of
from cdff_core.calibration.boards import Board
from cdff_dev.calibrate.board_views import grey_of_frame
from cdff_dev.calibrate.drive import Inertial, frame_of, inertial
from cdff_dev.logs.opened import opened
from cdff_dev.logs.source import LogSource

#: Longest interval between two poses of the hand that are interpolated, seconds.
_LONGEST_GAP_S = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class BoardImages:
    """Poses of a board in the images of one camera.

    Attributes
    ----------
    frame : str
        Frame of the camera.
    stamps_ns : ndarray, shape (n,)
        Of all images.
    poses : list of BoardPose
        Their ``number`` is the number of the image.
    """

    frame: str
    stamps_ns: NDArray[np.int64]
    poses: list[BoardPose]


def board_images(path: Path, board: Board, calibration: Path | None, stream: str | None) -> BoardImages:
    """Return the poses of a board in a log or folder of images.

    Raises
    ------
    InputError
        If the log does not have one stream of images, or the camera is unknown.
    """
    folder = path / "images"
    with opened(folder if folder.is_dir() else path) as log:
        name = one_stream(log, ("Frame", "FramePair"), "images", stream, "--stream")
        camera = None if calibration is None else read_camera(calibration)
        views: list[View] = []
        stamps: list[int] = []
        frame = frame_of(log, name)
        progress = Progress(log.streams[name].count, "images")
        for k, sample in enumerate(log.samples([name])):
            image = sample.value.left if log.streams[name].type_name == "FramePair" else sample.value
            grey = grey_of_frame(image)
            camera = camera or _camera_of(image, name)
            if grey.shape != (camera.rows, camera.cols):
                raise InputError(
                    f"{name}: image of {grey.shape[1]} x {grey.shape[0]} pixels, expected the "
                    f"{camera.cols} x {camera.rows} of the calibration"
                )
            stamps.append(sample.stamp_ns)
            numbers, pixels = board.detect(grey)
            if len(numbers):
                views.append(View(0, k, board.corners_m[numbers], pixels, numbers))
            progress.advance()
        progress.close()
    if camera is None:
        raise InputError(f"{path}: no images")
    return BoardImages(frame, np.array(stamps, np.int64), board_poses_of(camera, views))


def hand_poses(
    path: Path, file: Path | None, stream: str | None
) -> tuple[str, NDArray[np.int64], FloatArray]:
    """Return the frame of the hand, stamps ``(m,)`` and poses ``(m, 4, 4)`` of a TUM file or of the log."""
    default = path / "poses.tum"
    if file is None and stream is None and path.is_dir() and default.is_file():
        file = default
    if file is not None:
        stamps, poses = read_tum(file)
        return "", stamps, poses
    with opened(path) as log:
        name = one_stream(log, ("TransformWithCovariance",), "poses of the hand", stream, "--hand")
        samples = sorted(log.samples([name]), key=lambda sample: sample.stamp_ns)
        poses = np.array([sample.value.transform.matrix for sample in samples])
        return samples[0].value.child_frame, np.array([s.stamp_ns for s in samples], np.int64), poses


def imu_readings(path: Path, file: Path | None, stream: str | None) -> Inertial:
    """Return the readings of an IMU: of a table (default ``imu.csv`` in the folder), or of the log.

    Raises
    ------
    InputError
        If there is not one stream of readings.
    """
    default = path / "imu.csv"
    if file is None and path.is_dir() and default.is_file():
        file = default
    with opened(path if file is None else file) as log:
        return inertial(log, one_stream(log, ("IMUSensors",), "readings of an IMU", stream, "--imu"))


def poses_at(
    wanted_ns: NDArray[np.int64], stamps_ns: NDArray[np.int64], poses: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_], str]:
    """Return interpolated poses ``(n, 4, 4)``, a mask of the times that have one, and ``time`` or ``order``.

    Images and poses that were saved one by one often have no common clock: if their numbers are equal and the
    times of less than half of the images are between two poses, image k belongs to pose k.
    """
    result, is_known = np.tile(np.eye(4), (len(wanted_ns), 1, 1)), np.zeros(len(wanted_ns), dtype=bool)
    after = np.searchsorted(stamps_ns, wanted_ns)
    for k, (stamp, b) in enumerate(zip(wanted_ns, after, strict=True)):
        if b < len(stamps_ns) and stamps_ns[b] == stamp:
            result[k], is_known[k] = poses[b], True
        elif 0 < b < len(stamps_ns) and stamps_ns[b] - stamps_ns[b - 1] <= _LONGEST_GAP_S * 1e9:
            fraction = float(stamp - stamps_ns[b - 1]) / float(stamps_ns[b] - stamps_ns[b - 1])
            result[k], is_known[k] = se3.interpolate_transform(poses[b - 1], poses[b], fraction), True
    if 2 * int(is_known.sum()) < len(wanted_ns) == len(poses):
        return poses, np.ones(len(poses), dtype=bool), "order"
    return result, is_known, "time"


def scans_at(
    path: Path, wanted_ns: NDArray[np.int64], stream: str | None, tolerance_s: float
) -> tuple[str, list[FloatArray | None], str]:
    """Return the frame of the lidar, the scans ``(p, 3)``, and ``time`` or ``order``; see ``poses_at``.

    A time without a scan within the tolerance has None.
    """
    folder = path / "clouds"
    with opened(folder if folder.is_dir() else path) as log:
        name = one_stream(log, ("LidarScan", "Pointcloud"), "clouds", stream, "--lidar")
        type_name = log.streams[name].type_name
        frame = frame_of(log, name)
        scan_ns = np.array([sample.stamp_ns for sample in log.samples([name])], np.int64)
        wanted = _nearest(wanted_ns, scan_ns, tolerance_s)
        paired_by = "time"
        if 2 * int((wanted >= 0).sum()) < len(wanted_ns) == len(scan_ns):
            wanted, paired_by = np.arange(len(scan_ns)), "order"
        scans: list[FloatArray | None] = [None] * len(wanted_ns)
        for k, sample in enumerate(log.samples([name])):
            for image in np.flatnonzero(wanted == k):
                cloud = sample.value.data if type_name == "LidarScan" else sample.value
                scans[int(image)] = np.asarray(cloud.points, np.float64)
    return frame, scans, paired_by


def _nearest(
    wanted_ns: NDArray[np.int64], stamps_ns: NDArray[np.int64], tolerance_s: float
) -> NDArray[np.int64]:
    """Return the number of the nearest stamp; -1 beyond the tolerance."""
    if not len(stamps_ns):
        return np.full(len(wanted_ns), -1)
    differences = np.abs(wanted_ns[:, None] - stamps_ns[None, :])
    nearest = differences.argmin(axis=1)
    is_near = differences[np.arange(len(wanted_ns)), nearest] <= tolerance_s * 1e9
    return np.where(is_near, nearest, -1).astype(np.int64)


def one_stream(log: LogSource, types: Sequence[str], content: str, chosen: str | None, option: str) -> str:
    """Return the chosen stream, or the only one of the types; raises InputError."""
    names = [n for n, info in log.streams.items() if info.type_name in types and info.count]
    names = [name for name in names if "/truth." not in name]
    if chosen is not None:
        if chosen not in names:
            raise InputError(f"{option} {chosen}: expected one of {', '.join(names) or 'none'}")
        return chosen
    if len(names) != 1:
        raise InputError(
            f"streams of {content}: {', '.join(names) or 'none'}; expected one, choose with {option}"
        )
    return names[0]


def _camera_of(image: Frame, name: str) -> CameraModel:
    try:
        return CameraModel.of_frame(image)
    except InputError as error:
        raise InputError(f"{name}: {error}; state the calibration with --camera FILE") from error
