# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cameras of a Kalibr camchain."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.camera.elements import Cameras, Poses, numbers, square
from cdff_common.camera.model import CameraModel
from cdff_common.errors import InputError
from cdff_common.geometry import se3


def kalibr_cameras(document: Mapping[str, Any]) -> tuple[Cameras, Poses]:
    """Return the cameras, and the poses of the IMU in their frames, or without these, of the first camera."""
    cameras: Cameras = {}
    poses: Poses = {}
    # T_camera_first; None after a missing link of the chain.
    T: NDArray[np.float64] | None = np.eye(4)
    previous: int | None = None
    for name in sorted((k for k in document if re.fullmatch(r"cam\d+", str(k))), key=lambda k: int(k[3:])):
        entry = document[name]
        lens, distortion = entry["camera_model"], entry.get("distortion_model", "none")
        if lens != "pinhole" or distortion not in ("radtan", "equidistant", "none"):
            raise InputError(
                f"{name}: {lens} with {distortion}, expected pinhole with radtan, equidistant or none"
            )
        fx, fy, cx, cy = numbers(entry["intrinsics"])
        cols, rows = (int(v) for v in entry["resolution"])
        coefficients = [] if distortion == "none" else numbers(entry["distortion_coeffs"])
        fisheye = distortion == "equidistant"
        K = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
        cameras[name] = CameraModel.from_matrix(K, coefficients, rows=rows, cols=cols, fisheye=fisheye)
        number = int(name[3:])
        if previous is not None:
            is_consecutive = previous == number - 1 and "T_cn_cnm1" in entry
            T = square(entry["T_cn_cnm1"], 4) @ T if T is not None and is_consecutive else None
        previous = number
        if T is not None:
            poses[name] = T
    return cameras, _imu_poses(document, list(cameras)) or poses


def _imu_poses(document: Mapping[str, Any], names: Sequence[str]) -> Poses:
    """Return the poses of the IMU in the frames of the cameras; empty if a camera has none."""
    poses: Poses = {}
    for name in names:
        if "T_cam_imu" in document[name]:
            poses[name] = square(document[name]["T_cam_imu"], 4)
        elif "T_imu_cam" in document[name]:
            poses[name] = se3.inverse(square(document[name]["T_imu_cam"], 4))
    return poses if len(poses) == len(names) else {}
