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
from cdff_common.camera.model import CameraModel, LensName
from cdff_common.errors import InputError
from cdff_common.geometry import se3

#: Lenses of the pairs of camera model and distortion model.
_LENSES: dict[tuple[str, str], LensName] = {
    ("pinhole", "radtan"): "pinhole",
    ("pinhole", "none"): "pinhole",
    ("pinhole", "equidistant"): "fisheye",
    ("pinhole", "fov"): "fov",
    ("omni", "radtan"): "omnidirectional",
    ("omni", "none"): "omnidirectional",
}


def kalibr_cameras(document: Mapping[str, Any]) -> tuple[Cameras, Poses]:
    """Return the cameras, and the poses of the IMU in their frames, or without these, of the first camera."""
    cameras: Cameras = {}
    poses: Poses = {}
    # T_camera_first; None after a missing link of the chain.
    T: NDArray[np.float64] | None = np.eye(4)
    previous: int | None = None
    for name in sorted((k for k in document if re.fullmatch(r"cam\d+", str(k))), key=lambda k: int(k[3:])):
        entry = document[name]
        cameras[name] = _camera(name, entry)
        number = int(name[3:])
        if previous is not None:
            is_consecutive = previous == number - 1 and "T_cn_cnm1" in entry
            T = square(entry["T_cn_cnm1"], 4) @ T if T is not None and is_consecutive else None
        previous = number
        if T is not None:
            poses[name] = T
    return cameras, _imu_poses(document, list(cameras)) or poses


def _camera(name: str, entry: Mapping[str, Any]) -> CameraModel:
    """Return one camera; raises InputError if its models are not supported."""
    projection, distortion = entry["camera_model"], entry.get("distortion_model", "none")
    lens = _LENSES.get((projection, distortion))
    if lens is None:
        known = ", ".join(" with ".join(pair) for pair in _LENSES)
        raise InputError(f"{name}: {projection} with {distortion}, expected {known}")
    *mirror, fx, fy, cx, cy = numbers(entry["intrinsics"])
    if len(mirror) != (lens == "omnidirectional"):
        raise InputError(
            f"{name}: {len(mirror) + 4} intrinsics of {projection}, expected [xi,] fu, fv, pu, pv"
        )
    coefficients = [] if distortion == "none" else numbers(entry["distortion_coeffs"])
    cols, rows = (int(v) for v in entry["resolution"])
    K = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    return CameraModel.from_matrix(K, [*mirror, *coefficients], rows=rows, cols=cols, lens=lens)


def _imu_poses(document: Mapping[str, Any], names: Sequence[str]) -> Poses:
    """Return the poses of the IMU in the frames of the cameras; empty if a camera has none."""
    poses: Poses = {}
    for name in names:
        if "T_cam_imu" in document[name]:
            poses[name] = square(document[name]["T_cam_imu"], 4)
        elif "T_imu_cam" in document[name]:
            poses[name] = se3.inverse(square(document[name]["T_imu_cam"], 4))
    return poses if len(poses) == len(names) else {}
