# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Undistortion and stereo rectification by maps from ideal to real images [1]_ [2]_, cached per calibration.

References
----------
.. [1] Zhang, Z. (2000). A flexible new technique for camera calibration. IEEE TPAMI 22(11).
  doi:10.1109/34.888718
.. [2] Fusiello, A., Trucco, E., Verri, A. (2000). A compact algorithm for rectification of stereo pairs.
   Machine Vision and Applications 12. doi:10.1007/s001380050120
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.camera import CameraModel, StereoCalibration
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig

Interpolation = Literal["nearest", "linear", "cubic"]
_INTERPOLATIONS = {"nearest": cv2.INTER_NEAREST, "linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}
#: Number of cached pairs of maps: 1920 x 1200 pixels take 14 MB.
_CACHED_MAPS = 8
#: Number of points along each side of an image that define its outline in the ideal camera.
_OUTLINE = 64
#: Decimals (metres, and elements of the rotation) up to which poses of the right camera count as equal: on a
#: rotating mast the relative pose is computed from two poses and differs in its last bits.
_DECIMALS = 9


class LensMapConfig(DfnConfig):
    """Parameters of the undistorted image."""

    keep: float = Field(
        0.0, ge=0, le=1, description="0 crops to observed pixels, 1 keeps every pixel of the input"
    )
    interpolation: Interpolation = Field("linear", description="Interpolation between pixels")
    max_angle_deg: float | None = Field(
        None,
        gt=5,
        le=85,
        description="Crop a wide view to this angle from the optical axis; by default an image that reaches "
        "beyond 84 degrees is refused",
    )


@dataclass(frozen=True, slots=True, eq=False)
class Rectified:
    """An ideal (undistorted) camera, and the maps from its pixels to those of the real camera.

    Attributes
    ----------
    camera : CameraModel
        Camera without distortion.
    R : ndarray, shape (3, 3)
        Rotation from the real to the ideal camera.
    maps : tuple of ndarray
        Fixed-point maps for ``cv2.remap``.
    """

    camera: CameraModel
    R: FloatArray
    maps: tuple[NDArray[Any], NDArray[Any]]

    def apply(self, image: NDArray[Any], interpolation: Interpolation = "linear") -> NDArray[Any]:
        """Return the image of the ideal camera, 0 outside the view; raises InputError for a wrong size."""
        if (self.camera.rows, self.camera.cols) != image.shape[:2]:
            size = f"{self.camera.rows} x {self.camera.cols}"
            raise InputError(
                f"image of {image.shape[0]} x {image.shape[1]} pixels, its calibration is for {size}"
            )
        return np.asarray(cv2.remap(image, *self.maps, _INTERPOLATIONS[interpolation]))


@lru_cache(maxsize=_CACHED_MAPS)
def undistorted(camera: CameraModel, keep: float, max_angle_deg: float | None = None) -> Rectified:
    """Return the ideal camera with the orientation of ``camera``.

    Parameters
    ----------
    camera : CameraModel
        Camera with known image size.
    keep : float
        0 crops to observed pixels, 1 keeps all pixels of the input; linear between them.
    max_angle_deg : float, optional
        Crop the view to this angle from the optical axis first.

    Raises
    ------
    InputError
        If the size is unknown, or the field of view is too wide for a flat image.
    """
    bounds = _bounds(camera, np.eye(3), max_angle_deg)
    return _with_maps(camera, np.eye(3), _ideal_cameras(camera, [bounds], keep)[0])


@dataclass(frozen=True, slots=True)
class _StereoPose:
    """Pose of the left camera in the right one; compared and hashed by ``rounded``."""

    rounded: bytes
    T_right_left: FloatArray = field(compare=False)

    @classmethod
    def of(cls, T_right_left: FloatArray) -> _StereoPose:
        # Adding 0 changes -0 to 0, whose bytes differ.
        return cls((np.round(T_right_left, _DECIMALS) + 0.0).tobytes(), T_right_left)


@lru_cache(maxsize=_CACHED_MAPS)
def _rectified_pair(
    left: CameraModel,
    right: CameraModel,
    stereo_pose: _StereoPose,
    keep: float,
    max_angle_deg: float | None,
) -> tuple[Rectified, Rectified, float]:
    """Return both rectified cameras with their maps, and the baseline, metres."""
    T_right_left = stereo_pose.T_right_left
    R_left, R_right = _common_rotations(T_right_left)
    bounds = [_bounds(left, R_left, max_angle_deg), _bounds(right, R_right, max_angle_deg)]
    ideal = _ideal_cameras(left, bounds, keep)
    ideal_left, ideal_right = ideal
    rectified_left = _with_maps(left, R_left, ideal_left)
    rectified_right = _with_maps(right, R_right, ideal_right)
    return rectified_left, rectified_right, float(np.linalg.norm(T_right_left[:3, 3]))


def rectified(
    stereo: StereoCalibration, keep: float = 0.0, max_angle_deg: float | None = None
) -> tuple[Rectified, Rectified, float]:
    """Return two equal ideal cameras, the right one displaced along x of the left one, and the baseline (m).

    Each camera is rotated by half of the relative rotation, and then so that x is along the baseline, which
    distorts both images equally [2]_. ``keep`` and ``max_angle_deg`` are as for ``undistorted``, for both
    images together.

    Raises
    ------
    InputError
        If sizes are unknown or differ, the right camera is not to the right of the left one, or they have no
        common view.
    """
    if (stereo.left.rows, stereo.left.cols) != (stereo.right.rows, stereo.right.cols):
        raise InputError("stereo pair: left and right image differ in size, expected one size")
    return _rectified_pair(
        stereo.left, stereo.right, _StereoPose.of(stereo.T_right_left), keep, max_angle_deg
    )


def _common_rotations(T_right_left: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotations of both cameras to a common orientation with x along the baseline."""
    half, _ = cv2.Rodrigues(cv2.Rodrigues(T_right_left[:3, :3])[0] * 0.5)
    # Position of the right camera, in the orientation halfway between both cameras.
    to_right = -half.T @ T_right_left[:3, 3]
    x = to_right / np.linalg.norm(to_right)
    if x[0] < 0.5:
        raise InputError(
            f"right camera at {to_right.round(3).tolist()} m of the left one: expected to its right (x)"
        )
    z = np.cross(x, [0.0, 1.0, 0.0])
    z /= np.linalg.norm(z)
    R = np.stack([x, np.cross(z, x), z])
    return R @ half, R @ half.T


def _bounds(
    camera: CameraModel, R_ideal_real: FloatArray, max_angle_deg: float | None
) -> tuple[FloatArray, FloatArray]:
    """Return the inner and the outer box of a camera's view on the plane z = 1 of the rotated camera."""
    if not camera.rows or not camera.cols:
        raise InputError("camera without an image size: the calibration has none")
    u, v = np.linspace(0.0, camera.cols - 1.0, _OUTLINE), np.linspace(0.0, camera.rows - 1.0, _OUTLINE)
    sides = []
    for pixels in (
        np.column_stack([np.zeros_like(v), v]),
        np.column_stack([u, np.zeros_like(u)]),
        np.column_stack([np.full_like(v, camera.cols - 1.0), v]),
        np.column_stack([u, np.full_like(u, camera.rows - 1.0)]),
    ):
        if max_angle_deg is not None:
            pixels = _within_angle(camera, R_ideal_real, pixels, max_angle_deg)
        rays = camera.rays(pixels) @ R_ideal_real.T
        if not (rays[:, 2] > 0.1).all():
            raise InputError(
                "the field of view is too wide for a flat image: expected at most 84 degrees from the "
                "optical axis; set max_angle_deg, or crop the image"
            )
        sides.append(rays[:, :2] / rays[:, 2:])
    left, top, right, bottom = sides
    inner = np.array([left[:, 0].max(), top[:, 1].max(), right[:, 0].min(), bottom[:, 1].min()])
    outer = np.array([left[:, 0].min(), top[:, 1].min(), right[:, 0].max(), bottom[:, 1].max()])
    return inner, outer


def _within_angle(camera: CameraModel, R: FloatArray, pixels: FloatArray, max_angle_deg: float) -> FloatArray:
    """Return the pixels; one beyond the angle is moved towards the centre of the rotated view."""
    centre = camera.project(R.T[:, 2:].T)[0]
    fractions = np.linspace(0.0, 1.0, 4 * _OUTLINE)
    lines = centre + fractions[None, :, None] * (pixels - centre)[:, None]
    z = (camera.rays(lines.reshape(-1, 2)) @ R[2]).reshape(lines.shape[:2])
    is_within = np.logical_and.accumulate(z >= np.cos(np.deg2rad(max_angle_deg)), axis=1)
    last = np.maximum(is_within.sum(axis=1) - 1, 0)
    return np.asarray(lines[np.arange(len(lines)), last])


def _ideal_cameras(
    camera: CameraModel, bounds: list[tuple[FloatArray, FloatArray]], keep: float
) -> list[CameraModel]:
    """Return ideal cameras with a common focal length and principal point, centred on their views."""
    inner, outer = (np.array(boxes) for boxes in zip(*bounds, strict=True))
    inner_limits = np.array([inner[:, 1].max(), inner[:, 3].min(), (inner[:, 2] - inner[:, 0]).min()])
    outer_limits = np.array([outer[:, 1].min(), outer[:, 3].max(), (outer[:, 2] - outer[:, 0]).max()])
    if inner_limits[2] <= 0.0 or inner_limits[1] <= inner_limits[0]:
        raise InputError("the cameras have no common view")
    cols, rows = camera.cols - 1, camera.rows - 1
    inner_focal = max(cols / inner_limits[2], rows / (inner_limits[1] - inner_limits[0]))
    outer_focal = min(cols / outer_limits[2], rows / (outer_limits[1] - outer_limits[0]))
    f = float((1.0 - keep) * inner_focal + keep * outer_focal)
    y0, y1, _ = (1.0 - keep) * inner_limits + keep * outer_limits
    ideal = []
    for box in (1.0 - keep) * inner + keep * outer:
        cx, cy = cols / 2 - f * (box[0] + box[2]) / 2, rows / 2 - f * (y0 + y1) / 2
        ideal.append(CameraModel(camera.rows, camera.cols, f, f, float(cx), float(cy)))
    # One principal point, so that disparity 0 is at infinity.
    cx = float(np.mean([i.cx for i in ideal]))
    return [replace(i, cx=cx) for i in ideal]


def _with_maps(camera: CameraModel, R_ideal_real: FloatArray, ideal: CameraModel) -> Rectified:
    """Return an ideal camera, rotated from a real camera, with its maps."""
    cols, rows = np.meshgrid(np.arange(ideal.cols, dtype=np.float64), np.arange(ideal.rows, dtype=np.float64))
    x, y = (cols.ravel() - ideal.cx) / ideal.fx, (rows.ravel() - ideal.cy) / ideal.fy
    rays = np.column_stack([x, y, np.ones(cols.size)])
    pixels = np.nan_to_num(camera.project(rays @ R_ideal_real), nan=-1e4).reshape(*cols.shape, 2)
    maps = cv2.convertMaps(pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32), cv2.CV_16SC2)
    return Rectified(ideal, R_ideal_real, (maps[0], maps[1]))
