# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""KITTI odometry folders as logs: rectified grey pairs and, if available, true poses.

Geiger, A., Lenz, P., Urtasun, R. (2012). Are we ready for autonomous driving? The KITTI vision benchmark
suite. CVPR. doi:10.1109/CVPR.2012.6248074
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.camera import read_stereo
from cdff_common.errors import CodecError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.product import Header
from cdff_common.types import FramePair, TransformWithCovariance
from cdff_dev.logs.source import LogSample, StreamInfo, chosen_streams, recorded_header

ROBOT = "kitti"
PAIR, TRUTH = f"/{ROBOT}/navcam.pair", f"/{ROBOT}/truth.pose"
#: Left and right image folders: the benchmark's grey and colour ones, and those of extracts.
_IMAGE_FOLDERS = (
    ("image_0", "image_1"),
    ("image_2", "image_3"),
    ("image_l", "image_r"),
    ("image_l_kitti", "image_r_kitti"),
)
#: Rows of the projections of the colour cameras, if the calibration has them.
_COLOUR_CAMERAS = ("P2", "P3")
#: Calibration files, in order of precedence: next to that of an extract, ``calib.txt`` may belong to another
#: camera.
_CALIBRATIONS = ("calib_kitti.txt", "calib.txt")
#: Period of the images without ``times.txt``.
_PERIOD_US = 100_000


def is_kitti(folder: Path) -> bool:
    """Return True if a folder contains folders of left and right images and a calibration."""
    pairs = any((folder / left).is_dir() and (folder / right).is_dir() for left, right in _IMAGE_FOLDERS)
    return pairs and any((folder / name).is_file() for name in _CALIBRATIONS)


class KittiLog:
    """A KITTI sequence as a ``LogSource``; raises InputError if its files are inconsistent.

    Streams are ``/kitti/navcam.pair`` (FramePair) and, if ``poses.txt`` or ``poses/NN.txt`` exists,
    ``/kitti/truth.pose``: the pose of the left camera (``kitti/navcam_left``) in its first pose
    (``kitti/vo``). Stamps are those of ``times.txt``; without it they are multiples of 100 ms from 0.
    """

    def __init__(self, folder: Path) -> None:
        self._left, self._right = _images(folder)
        self.camera_matrix, self.baseline_m = _calibration(folder, self._left[0])
        n = len(self._left)
        self._stamps_ns = _stamps(folder, n)
        self._truth = _truth(folder, n)
        span = (int(self._stamps_ns[0]), int(self._stamps_ns[-1]))
        self.streams: dict[str, StreamInfo] = {PAIR: StreamInfo("FramePair", n, *span)}
        if self._truth is not None:
            self.streams[TRUTH] = StreamInfo("TransformWithCovariance", n, *span)

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of all or some streams in the order (stamp_ns, stream, seq).

        An image is read when its sample is yielded.

        Raises
        ------
        InputError
            If a stream is not in the log.
        CodecError
            If an image cannot be read.
        """
        names = chosen_streams(self.streams, streams)
        for i in range(len(self._left)):
            for name in names:
                stamp_ns = int(self._stamps_ns[i])
                value = self._pair(i, stamp_ns) if name == PAIR else self._pose(i, stamp_ns)
                yield LogSample(
                    name, self.streams[name].type_name, stamp_ns, i, value, _header(name, i, stamp_ns)
                )

    def close(self) -> None:
        """Do nothing: no file is kept open."""

    def _pair(self, i: int, stamp_ns: int) -> Any:
        return FramePair.from_images(
            _read_grey(self._left[i]),
            _read_grey(self._right[i]),
            baseline_m=self.baseline_m,
            camera_matrix=self.camera_matrix,
            stamp_ns=stamp_ns,
            sensor=f"{ROBOT}/navcam_left",
        )

    def _pose(self, i: int, stamp_ns: int) -> Any:
        assert self._truth is not None  # the stream exists only with true poses
        return TransformWithCovariance.from_transform(
            UncertainTransform(self._truth[i]),
            parent=f"{ROBOT}/vo",
            child=f"{ROBOT}/navcam_left",
            stamp_ns=stamp_ns,
            producer=ROBOT,
        )


def _header(stream: str, seq: int, stamp_ns: int) -> Header:
    camera = f"{ROBOT}/navcam_left"
    if stream == PAIR:
        return recorded_header(stream, seq, stamp_ns, frame=camera, producer=f"{ROBOT}/navcam")
    return recorded_header(
        stream, seq, stamp_ns, frame=f"{ROBOT}/vo", child=camera, producer=f"{ROBOT}/truth"
    )


def _images(folder: Path) -> tuple[list[Path], list[Path]]:
    for left_name, right_name in _IMAGE_FOLDERS:
        left, right = sorted((folder / left_name).glob("*.png")), sorted((folder / right_name).glob("*.png"))
        if left and [p.name for p in left] == [p.name for p in right]:
            return left, right
        if left or right:
            raise InputError(
                f"{folder}: {len(left)} images in {left_name}, {len(right)} in {right_name}: expected images "
                "with equal names"
            )
    known = " or ".join(f"{a} and {b}" for a, b in _IMAGE_FOLDERS)
    raise InputError(f"{folder}: expected a KITTI sequence with images in {known}")


def _read_grey(path: Path) -> Any:
    import cv2

    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise CodecError(f"{path}: not an image that can be read")
    return image


def _rows(path: Path, columns: int) -> FloatArray:
    """Return the numbers ``(n, columns)`` of a text file, without a label before a colon in a line."""
    rows = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        words = line.split(":")[-1].split()
        try:
            values = [float(word) for word in words]
        except ValueError as error:
            raise InputError(f"{path}:{number}: {error}") from error
        if len(values) == columns:
            rows.append(values)
        elif values:
            raise InputError(f"{path}:{number}: {len(values)} numbers, expected {columns}")
    if not rows:
        raise InputError(f"{path}: expected lines of {columns} numbers")
    return np.array(rows)


def _calibration(folder: Path, image: Path) -> tuple[FloatArray, float]:
    """Return the camera matrix ``(3, 3)`` of the left camera, and the baseline, metres.

    They are of ``P2`` and ``P3`` for the images of the colour cameras, else of the first two cameras. Raises
    InputError if the principal point lies outside the image: then the calibration is of another camera.
    """
    path = next((folder / name for name in _CALIBRATIONS if (folder / name).is_file()), None)
    if path is None:
        raise InputError(f"{folder}: expected {' or '.join(_CALIBRATIONS)}")
    is_colour = image.parent.name == "image_2" and _has_rows(path, _COLOUR_CAMERAS)
    calibration = read_stereo(path, *_COLOUR_CAMERAS) if is_colour else read_stereo(path)
    if not calibration.is_rectified:
        raise InputError(
            f"{path}: expected a rectified pair with the right camera to the right of the left camera"
        )
    matrix = calibration.left.matrix
    rows, cols = _read_grey(image).shape
    if not (0.0 < matrix[0, 2] < cols and 0.0 < matrix[1, 2] < rows):
        raise InputError(
            f"{path}: principal point {matrix[0, 2]:.1f}, {matrix[1, 2]:.1f} outside the images of "
            f"{cols} x {rows} pixels; the calibration is of another camera"
        )
    return matrix, calibration.baseline_m


def _has_rows(path: Path, names: Collection[str]) -> bool:
    """Return whether a calibration file has rows of all names."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    return set(names) <= {line.partition(":")[0].strip() for line in lines}


def _stamps(folder: Path, n: int) -> np.ndarray:
    path = folder / "times.txt"
    if not path.is_file():
        return np.arange(n, dtype=np.int64) * (_PERIOD_US * 1000)
    times_s = _rows(path, 1)[:, 0]
    if len(times_s) < n or np.any(np.diff(times_s[:n]) <= 0):
        raise InputError(f"{path}: {len(times_s)} times for {n} images, expected one per image, ascending")
    return np.round(times_s[:n] * 1e6).astype(np.int64) * 1000


def _poses_file(folder: Path) -> Path | None:
    """Return ``poses.txt``, else ``poses/NN.txt`` in the folder, or in that of ``sequences/NN``."""
    name = f"{folder.resolve().name}.txt"
    own = sorted((folder / "poses").glob("[0-9][0-9].txt"))
    benchmark = folder.resolve().parents[1] / "poses" / name if len(folder.resolve().parents) > 1 else folder
    candidates = [folder / "poses.txt", folder / "poses" / name, *(own if len(own) == 1 else []), benchmark]
    return next((path for path in candidates if path.is_file()), None)


def _truth(folder: Path, n: int) -> FloatArray | None:
    path = _poses_file(folder)
    if path is None:
        return None
    rows = _rows(path, 12).reshape(-1, 3, 4)
    if len(rows) < n:
        raise InputError(f"{path}: {len(rows)} poses for {n} images")
    return se3.transform(se3.normalise_rotation(rows[:n, :, :3]), rows[:n, :, 3])
