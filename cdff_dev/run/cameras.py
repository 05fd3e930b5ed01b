# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images and stereo pairs with the camera models of a calibration file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from cdff_common.camera import CameraModel, StereoCalibration, check_image_size, read_camera, read_stereo
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import Frame, FrameCameraModelT, FramePair
from cdff_core.imaging.frames import with_image


def with_camera(frame: Frame, calibration: str, name: str = "") -> Frame:
    """Return an image with a camera of a calibration file, by default the first camera.

    Raises
    ------
    InputError
        If the file is not a calibration, has no such camera, or is for another image size.
    """
    camera = read_camera(Path(calibration), name)
    return _with_camera_model(camera, frame, calibration)


def stereo_pair(
    left: NDArray[Any],
    right: NDArray[Any],
    calibration: str,
    names: tuple[str, str] = ("", ""),
    *,
    frame: str,
    stamp_ns: int,
) -> FramePair:
    """Return two images as a stereo pair of two cameras of a calibration file, by default the first two.

    If the calibration is that of a rectified pair, the poses of the cameras are not set. Otherwise each image
    has its camera model and its pose in the frame of the left camera, for StereoRectification.

    Parameters
    ----------
    left, right : ndarray
        Grey images of equal size.
    calibration : str
        Path of the file.
    names : tuple of str
        Names of the left and the right camera in the file.
    frame : str
        Frame of the left camera.

    Raises
    ------
    InputError
        See ``with_camera``; also if the file has no relative pose of the cameras.
    """
    stereo = read_stereo(Path(calibration), *names)
    pair = FramePair.from_images(
        left,
        right,
        baseline_m=stereo.baseline_m,
        camera_matrix=stereo.left.matrix,
        stamp_ns=stamp_ns,
        sensor=frame,
        T_robot_sensor=None if stereo.is_rectified else UncertainTransform.identity(),
    )
    if stereo.is_rectified:
        for camera, image in ((stereo.left, pair.left), (stereo.right, pair.right)):
            check_image_size(camera, image.image.shape[0], image.image.shape[1], calibration)
        return pair
    return FramePair(
        baseline=stereo.baseline_m,
        left=_with_camera_model(stereo.left, pair.left, calibration),
        right=_with_camera_model(stereo.right, _with_pose(pair.right, stereo, frame), calibration),
    )


def camera_document(frame: Frame) -> dict[str, Any] | None:
    """Return the camera of an image as a calibration document for ``with_camera``; None without camera."""
    if frame.intrinsic.camera_model is FrameCameraModelT.CAM_UNDEF:
        return None
    camera = CameraModel.of_frame(frame)
    rows, cols = frame.image.shape[:2]
    return {
        "image_width": cols,
        "image_height": rows,
        "camera_model": camera.lens,
        "camera_matrix": frame.camera_matrix.tolist(),
        "distortion_coefficients": list(camera.distortion),
    }


def _with_pose(right: Frame, stereo: StereoCalibration, left_frame: str) -> Frame:
    """Return the right image with the pose of its camera in the frame of the left camera."""
    T_left_right = UncertainTransform.exact(se3.inverse(stereo.T_right_left))
    name = right.frame if right.frame != left_frame else f"{left_frame}_right"
    return with_image(right, right.image, place=(name, T_left_right))


def _with_camera_model(camera: CameraModel, frame: Frame, calibration: str) -> Frame:
    check_image_size(camera, frame.image.shape[0], frame.image.shape[1], calibration)
    return with_image(frame, frame.image, camera=camera)
