# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mounts of sensors from a URDF and from camera calibrations, in the conventions of a profile.

A URDF has ``T_parent_link`` with roll, pitch and yaw about fixed axes in radians. OpenCV's ``R, T`` of a
stereo calibration and Kalibr's ``T_cn_cnm1`` and ``T_cam_imu`` map coordinates into the later camera: they
are inverted here, because an edge of a profile is the pose of the child in the parent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cdff_common.camera.read import read_cameras
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.geometry.urdf import RobotModel, read_urdf

_LARGEST_BYTES = 4 << 20
#: Largest difference of the elements of a calibration between camera and IMU from those of the identity,
#: which means that none is stated.
_IDENTITY = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class CameraMounts:
    """Poses of the cameras of a calibration.

    Attributes
    ----------
    source : str
        Name of the file.
    by_imu : bool
        True if the poses are those in the IMU, otherwise in the first camera.
    poses : mapping of str to array, shape (4, 4)
        ``T_imu_camera`` or ``T_first_camera`` by the name of the camera in the file; empty if it has none.
    """

    source: str
    by_imu: bool
    poses: Mapping[str, FloatArray]


def read_urdf_file(path: Path) -> RobotModel:
    """Return the model of a URDF file; raises InputError or ConfigurationError if it is unusable."""
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise InputError(f"{path}: larger than {_LARGEST_BYTES} bytes, expected a URDF")
        return read_urdf(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: {error}") from error


def urdf_frames(model: RobotModel, robot: str) -> frozenset[str]:
    """Return the frames of a profile that the links of a URDF become."""
    return frozenset({f"{robot}/base"} | {model.frame(robot, joint.child) for joint in model.joints})


def camera_mounts(path: Path) -> CameraMounts:
    """Return the poses of the cameras of an OpenCV, ROS or Kalibr calibration.

    Raises
    ------
    InputError
        If the file is no calibration.
    """
    cameras, poses = read_cameras(path)
    inverse = {name: se3.inverse(poses[name]) for name in cameras if name in poses}
    first = next(iter(inverse.values()), None)
    by_imu = first is not None and float(np.abs(first - np.eye(4)).max()) > _IDENTITY
    return CameraMounts(path.name, by_imu, inverse)


def edge_line(parent: str, child: str, T: FloatArray | None, comment: str = "") -> str:
    """Return an edge of ``frames`` in YAML; None as the transform is a mount to be entered."""
    if T is None:
        return f"{{parent: {parent}, child: {child}, translation_m: [0.0, 0.0, 0.0]}}{comment}"
    q = se3.quaternion_xyzw_from_matrix(T[:3, :3])
    translation = ", ".join(f"{v:.5f}" for v in T[:3, 3])
    rotation = ", ".join(f"{v:.7f}" for v in q)
    return (
        f"{{parent: {parent}, child: {child}, translation_m: [{translation}], "
        f"quaternion_xyzw: [{rotation}]}}{comment}"
    )
