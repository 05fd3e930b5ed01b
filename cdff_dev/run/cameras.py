# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images with the camera model of a calibration file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from cdff_common.camera import CameraModel, StereoCalibration, read_camera, read_stereo
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import Frame, FrameCameraModelT, FramePair
from cdff_core.imaging.frames import with_image


def with_camera(frame: Frame, calibration: str, name: str = "") -> Frame:
    """Return the image with a camera of a calibration file, by default the first one.

    Raises
    ------
    InputError
        If the file is no calibration, has no such camera, or is for another size of image.
    """
    camera = read_camera(Path(calibration), name)
    return _taken_by(camera, frame, calibration)


def stereo_pair(
    left: NDArray[Any],
    right: NDArray[Any],
    calibration: str,
    names: tuple[str, str] = ("", ""),
    *,
    frame: str,
    stamp_ns: int,
) -> FramePair:
    """Two images as a pair of two cameras of a calibration file, by default the file's first and second.

    With the calibration of a rectified pair the poses of the cameras are left empty. Otherwise each image
    has its own lens and its pose in the left camera's frame, as StereoRectification needs.

    Parameters
    ----------
    left, right : ndarray
        Grey, of one size.
    calibration : str
        Path of the file.
    names : tuple of str
        Names of the left and the right camera in the file.
    frame : str
        Of the left camera.

    Raises
    ------
    InputError
        Like ``with_camera``, or if the file has no relative pose of the cameras.
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
            _check_size(camera, image, calibration)
        return pair
    return FramePair(
        baseline=stereo.baseline_m,
        left=_taken_by(stereo.left, pair.left, calibration),
        right=_taken_by(stereo.right, _placed(pair.right, stereo, frame), calibration),
    )


def camera_document(frame: Frame) -> dict[str, Any] | None:
    """Return the text from which ``with_camera`` reads the camera of an image; None if it has none."""
    model = frame.intrinsic.camera_model
    if model not in (FrameCameraModelT.CAM_PINHOLE, FrameCameraModelT.CAM_FISHEYE):
        return None
    rows, cols = frame.image.shape[:2]
    return {
        "image_width": cols,
        "image_height": rows,
        "camera_model": "fisheye" if model is FrameCameraModelT.CAM_FISHEYE else "pinhole",
        "camera_matrix": frame.camera_matrix.tolist(),
        "distortion_coefficients": frame.intrinsic.dist_coeffs.tolist(),
    }


def _placed(right: Frame, stereo: StereoCalibration, left_frame: str) -> Frame:
    """The right image where the calibration has its camera."""
    T_left_right = UncertainTransform.exact(se3.inverse(stereo.T_right_left))
    name = right.frame if right.frame != left_frame else f"{left_frame}_right"
    return with_image(right, right.image, place=(name, T_left_right))


def _taken_by(camera: CameraModel, frame: Frame, calibration: str) -> Frame:
    _check_size(camera, frame, calibration)
    return with_image(frame, frame.image, camera=camera)


def _check_size(camera: CameraModel, frame: Frame, calibration: str) -> None:
    """Refuse an image of another size than the calibration states."""
    rows, cols = frame.image.shape[:2]
    if camera.rows and camera.cols and (camera.rows, camera.cols) != (rows, cols):
        raise InputError(
            f"{calibration}: for {camera.cols} x {camera.rows} pixels, the image has {cols} x {rows}: "
            "expected the size that was calibrated"
        )
