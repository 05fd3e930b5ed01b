# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stereo pairs of EuRoC V1_01 (Burri et al. 2016, doi:10.1177/0278364915620033) with their true poses."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import FramePair

FOLDER = "euroc_v101_pairs"
_SIZE = (752, 480)


@dataclass(frozen=True, slots=True, eq=False)
class StereoView:
    """A rectified pair and the true pose ``T_world_left`` (4, 4) of the rectified left camera."""

    pair: FramePair
    T_world_left: FloatArray

    @property
    def stamp_s(self) -> float:
        """Time of the pair, seconds."""
        return 1e-9 * float(self.pair.stamp_ns)


def cameras(folder: Path) -> list[dict[str, Any]]:
    """Return the calibrations of both cameras."""
    text = (folder / "calibration.yaml").read_text(encoding="utf-8").partition("\n")[2]
    return [yaml.safe_load(text)[name] for name in ("cam0", "cam1")]


def stereo_views(folder: Path) -> list[StereoView]:
    """Return all pairs of the set, rectified, by increasing time."""
    calibrations = cameras(folder)
    matrices = [
        np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]) for fx, fy, cx, cy in _intrinsics(calibrations)
    ]
    lenses = [np.array(c["distortion_coeffs"], np.float64) for c in calibrations]
    T_imu = [np.array(c["T_imu_cam"], np.float64) for c in calibrations]
    T_right_left = np.linalg.inv(T_imu[1]) @ T_imu[0]
    R_left, R_right, P_left, P_right, *_ = cv2.stereoRectify(
        matrices[0],
        lenses[0],
        matrices[1],
        lenses[1],
        _SIZE,
        se3.normalise_rotation(T_right_left[:3, :3]),
        T_right_left[:3, 3:],
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )
    maps = [
        cv2.initUndistortRectifyMap(K, lens, R, P, _SIZE, cv2.CV_32FC1)
        for K, lens, R, P in zip(matrices, lenses, (R_left, R_right), (P_left, P_right), strict=True)
    ]
    baseline_m = -float(P_right[0, 3] / P_right[0, 0])
    T_imu_left = se3.transform(se3.normalise_rotation(T_imu[0][:3, :3]), T_imu[0][:3, 3])
    T_imu_left = T_imu_left @ se3.transform(R_left.T, np.zeros(3))
    views, poses = [], true_poses(folder)
    for path in sorted(folder.glob("*/*_0.jpg"), key=lambda p: p.name):
        stamp_ns = int(path.name.split("_")[0])
        images = [
            cv2.remap(_grey(file), *lookup, cv2.INTER_CUBIC)
            for file, lookup in zip((path, path.with_name(f"{stamp_ns}_1.jpg")), maps, strict=True)
        ]
        pair = FramePair.from_images(
            *(np.asarray(image, np.uint8) for image in images),
            baseline_m=baseline_m,
            camera_matrix=P_left[:, :3],
            stamp_ns=stamp_ns // 1000 * 1000,  # messages contain microseconds
        )
        views.append(StereoView(pair, poses[stamp_ns] @ T_imu_left))
    return views


def _intrinsics(calibrations: list[dict[str, Any]]) -> list[list[float]]:
    return [calibration["intrinsics"] for calibration in calibrations]


def true_poses(folder: Path) -> dict[int, FloatArray]:
    """Return ``T_world_imu`` (4, 4) by time stamp."""
    poses = {}
    for name in ("truth_map.csv", "truth_query.csv"):
        with (folder / name).open(encoding="utf-8") as file:
            for row in list(csv.reader(file))[1:]:
                values = np.array(row[1:], np.float64)
                poses[int(row[0])] = se3.transform(Rotation.from_quat(values[3:]).as_matrix(), values[:3])
    return poses


def _grey(path: Path) -> Any:
    """Read an image as grey values; raises InputError if it is not readable."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise InputError(f"{path}: expected a readable image")
    return image
