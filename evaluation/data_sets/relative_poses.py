# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Real image pairs of calibrated cameras with a known relative pose: stereo rigs, and one moving camera."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from evaluation.data_sets import euroc, kitti, minnie
from evaluation.data_sets.image_pairs import Image

Float = NDArray[np.float64]

#: Standard deviations of the lever arm from depth to colour camera, and of one pose of KinectFusion: the
#: depth of neighbouring frames agrees within 1 to 3 mm (README of the set), which is 0.1 degrees at 2 m.
_KITCHEN_LEVER_M, _KITCHEN_SIGMA_M, _KITCHEN_SIGMA_RAD = (0.025, 0.005, 0.005), 0.003, np.radians(0.1)
#: Nominal camera matrix of the sensor; the lens distortion is not known.
_KITCHEN_CAMERA = np.array([[525.0, 0.0, 320.0], [0.0, 525.0, 240.0], [0.0, 0.0, 1.0]])
#: Differences between the calibrated sensors of this type (Freiburg 1 and 2 of TUM RGB-D) and the nominal
#: camera: 1.8 % of the focal length in the principal point (RMS), and 6 px at the edge of the image by focal
#: length and distortion.
_KITCHEN_CAMERA_ERRORS = {"principal_point_ratio": 0.018, "lens_edge_px": 6.0}


@dataclass(frozen=True, slots=True, eq=False)
class PosedPair:
    """Two images without lens distortion, and the true relative pose of their cameras.

    Attributes
    ----------
    set_name : str
    left, right : ndarray of uint8, shapes (rows, columns)
    K_left, K_right : ndarray, shape (3, 3)
        Camera matrices, pixels.
    T_left_right : ndarray, shape (4, 4)
        True pose, translation in metres.
    is_stereo : bool
        True for a stereo rig, whose calibration is more accurate than the pose of a moving camera.
    covariance : ndarray, shape (6, 6)
        Of the true pose, metres and radians; 0 if it is more accurate than the results.
    camera_errors : dict of float
        Standard deviations of the errors of the cameras, as parameters of the essential matrix; empty for
        calibrated cameras, to which the default parameters apply.
    """

    set_name: str
    left: Image
    right: Image
    K_left: Float
    K_right: Float
    T_left_right: Float
    is_stereo: bool
    covariance: Float = field(default_factory=lambda: np.zeros((6, 6)))
    camera_errors: dict[str, float] = field(default_factory=dict)


def posed_pairs(data: Path, stride: int = 1) -> Iterator[PosedPair]:
    """Yield every ``stride``-th pair of each set; of KITTI, which has the fewest, twice as many."""
    yield from _kitti(data, max(stride // 2, 1))
    yield from _minnie(data)
    yield from _euroc(data, stride)
    yield from _kitchen(data, stride)


def _kitti(data: Path, stride: int) -> Iterator[PosedPair]:
    """Yield stereo pairs, and pairs of the left camera of 1 and 3 frames apart (about 1.2 m and 3.6 m)."""
    pairs, poses = kitti.read(data / kitti.SEQUENCE)
    K = np.array(pairs[0].camera_matrix)
    rig = se3.transform(np.eye(3), np.array([pairs[0].baseline, 0.0, 0.0]))
    start = kitti.measured_from(poses)
    for i in range(0, len(pairs), stride):
        left = np.array(pairs[i].left.image)
        yield PosedPair("kitti_stereo", left, np.array(pairs[i].right.image), K, K, rig, True)
        for gap in (1, 3):
            if i >= start and i + gap < len(pairs):
                T = se3.inverse(poses[i]) @ poses[i + gap]
                right = np.array(pairs[i + gap].left.image)
                yield PosedPair(f"kitti_{gap}_frames", left, right, K, K, T, False)


def _minnie(data: Path) -> Iterator[PosedPair]:
    """Yield both stereo pairs at half size (the rover's step has no accurate reference)."""
    for pair in minnie.pairs(data / minnie.FOLDER, scale=0.5):
        images = (cv2.cvtColor(np.array(f.image), cv2.COLOR_BGR2GRAY) for f in (pair.left, pair.right))
        K = np.array(pair.camera_matrix)
        rig = se3.transform(np.eye(3), np.array([pair.baseline, 0.0, 0.0]))
        yield PosedPair("minnie_stereo", *(np.asarray(i, np.uint8) for i in images), K, K, rig, True)


def _euroc(data: Path, stride: int) -> Iterator[PosedPair]:
    """Yield stereo pairs; the lens distortion is removed with the calibration of the set."""
    folder = data / euroc.FOLDER
    cameras = euroc.cameras(folder)
    T_imu = [np.array(camera["T_imu_cam"], np.float64) for camera in cameras]
    T_left_right = se3.inverse(T_imu[0]) @ T_imu[1]
    T_left_right[:3, :3] = se3.normalise_rotation(T_left_right[:3, :3])
    matrices, maps = [], []
    for camera in cameras:
        fx, fy, cx, cy = camera["intrinsics"]
        K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        lens = np.array(camera["distortion_coeffs"], np.float64)
        matrices.append(K)
        maps.append(cv2.initUndistortRectifyMap(K, lens, np.eye(3), K, (752, 480), cv2.CV_32FC1))
    for path in sorted(folder.glob("*/*_0.jpg"))[::stride]:
        files = (path, path.with_name(path.name.replace("_0.jpg", "_1.jpg")))
        images = [
            np.asarray(cv2.remap(_jpeg(f), *m, cv2.INTER_CUBIC), np.uint8)
            for f, m in zip(files, maps, strict=True)
        ]
        yield PosedPair("euroc_stereo", *images, *matrices, T_left_right, True)


def _kitchen(data: Path, stride: int) -> Iterator[PosedPair]:
    """Yield pairs of a hand-held camera, 3, 9 and 18 frames apart (about 1 cm, 3 cm and 6 cm).

    The poses are those of the depth camera, about 2.5 cm from the colour camera.
    """
    folder = data / "seven_scenes_redkitchen"
    with (folder / "truth.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(file))[1:]
    poses = {}
    for row in rows:
        T = np.eye(4)
        T[:3] = np.array(row[1:], np.float64).reshape(3, 4)
        T[:3, :3] = se3.normalise_rotation(T[:3, :3])
        poses[int(row[0])] = T
    for i in sorted(poses)[::stride]:
        for gap in (3, 9, 18):
            if i + gap in poses:
                left, right = (_jpeg(folder / "frames" / f"{k:06d}.color.jpg") for k in (i, i + gap))
                T = se3.inverse(poses[i]) @ poses[i + gap]
                K = _KITCHEN_CAMERA
                covariance = _kitchen_covariance(T)
                yield PosedPair(
                    f"kitchen_{gap}_frames", left, right, K, K, T, False, covariance, _KITCHEN_CAMERA_ERRORS
                )


def _kitchen_covariance(T: Float) -> Float:
    """Return the covariance (6, 6) of the pose of the colour camera, given that of the depth camera.

    The lever arm between the cameras, of unknown sign along x, enters with the rotation.
    """
    lever = (T[:3, :3] - np.eye(3)) @ np.diag(_KITCHEN_LEVER_M)
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = lever @ lever.T + 2.0 * _KITCHEN_SIGMA_M**2 * np.eye(3)
    covariance[3:, 3:] = 2.0 * _KITCHEN_SIGMA_RAD**2 * np.eye(3)
    return covariance


def _jpeg(path: Path) -> Image:
    """Read a JPEG file as 8-bit grey values; raises InputError if it is not readable."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise InputError(f"{path}: expected a readable JPEG image")
    return np.asarray(image, np.uint8)
