# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Frames derived from other frames: stamp, colour mode, camera and pose are copied unless replaced."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.camera import CameraModel
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.types import Array3D, Frame, FrameCameraModelT, FrameModeT, TransformWithCovariance

#: Largest difference of the capture times of a pair: at 0.2 rad/s, a camera with a focal length of 1000 px
#: rotates by 4 px in this time.
LARGEST_DIFFERENCE_NS = 20_000_000
#: Smallest distance of the principal point from the border of an image, relative to its size.
_LEAST_BORDER = 0.1


def check_undistorted(*images: Frame) -> None:
    """Raise InputError if an image has lens distortion or is not of a pinhole camera."""
    for image in images:
        intrinsic = image.intrinsic
        is_other_lens = intrinsic.camera_model in (FrameCameraModelT.CAM_FISHEYE, FrameCameraModelT.CAM_MAPS)
        if is_other_lens or np.any(intrinsic.dist_coeffs):
            lens = f"{intrinsic.camera_model.name}, distortion {intrinsic.dist_coeffs.tolist()}"
            raise InputError(
                f"image of {image.frame or 'a camera'} has lens distortion ({lens}): expected an undistorted "
                "image, by image_undistortion or, for a stereo pair, stereo_rectification"
            )


def check_principal_point(image: Frame) -> None:
    """Raise InputError if the principal point is not in the image, or at its border.

    Such a camera matrix is usually that of images of another size.
    """
    rows, cols = image.image.shape[:2]
    position = np.asarray(image.camera_matrix, np.float64)[:2, 2] / [cols, rows]
    if (np.abs(position - 0.5) > 0.5 - _LEAST_BORDER).any():
        column, row = (float(v) for v in np.asarray(image.camera_matrix)[:2, 2])
        raise InputError(
            f"image of {image.frame or 'a camera'}: principal point ({column:.1f}, {row:.1f}) of an image of "
            f"{cols} x {rows} pixels, expected one at least {_LEAST_BORDER:.0%} of the size from its border; "
            "state the camera matrix of images of this size"
        )


def check_simultaneous(left: Frame, right: Frame) -> None:
    """Raise InputError if the capture times of a pair differ by more than ``LARGEST_DIFFERENCE_NS``.

    A stamp of 0 is an unknown time.
    """
    difference_ns = right.stamp_ns - left.stamp_ns
    if left.stamp_ns and right.stamp_ns and abs(difference_ns) > LARGEST_DIFFERENCE_NS:
        raise InputError(
            f"right image {difference_ns * 1e-9:+.3f} s after the left one: expected at most "
            f"{LARGEST_DIFFERENCE_NS * 1e-9:g} s between them; synchronise the cameras"
        )


def with_image(
    frame: Frame,
    image: NDArray[Any],
    *,
    mode: FrameModeT | None = None,
    camera: CameraModel | None = None,
    place: tuple[str, UncertainTransform] | None = None,
) -> Frame:
    """Return a frame with other pixels, and another colour mode, camera or pose if given.

    ``place`` is the name of the new sensor frame and ``T_robot_sensor``.
    """
    metadata, intrinsic = frame.metadata, frame.intrinsic
    if mode is not None:
        metadata = replace(metadata, mode=mode)
    if camera is not None:
        intrinsic = replace(
            intrinsic,
            camera_matrix=camera.matrix,
            camera_model=camera.message_model,
            dist_coeffs=camera.message_coefficients,
        )
    new_frame = replace(
        frame, metadata=metadata, intrinsic=intrinsic, data=Array3D.from_array(np.ascontiguousarray(image))
    )
    if place is None:
        return new_frame
    sensor, T_robot_sensor = place
    pose = TransformWithCovariance.from_transform(
        T_robot_sensor,
        parent=frame.extrinsic.pose_robot_frame_sensor_frame.parent_frame,
        child=sensor,
        stamp_ns=frame.stamp_ns,
    )
    return replace(
        new_frame,
        intrinsic=replace(intrinsic, sensor_id=sensor),
        extrinsic=replace(frame.extrinsic, pose_robot_frame_sensor_frame=pose),
    )
