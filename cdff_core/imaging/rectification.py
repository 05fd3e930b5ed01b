# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From distorted images to ideal ones: the maps are made once per calibration and kept.

References
----------
.. [1] Zhang, Z. (2000). A flexible new technique for camera calibration. IEEE TPAMI 22(11). doi:10.1109/34.888718
.. [2] Fusiello, A., Trucco, E., Verri, A. (2000). A compact algorithm for rectification of stereo pairs. Machine Vision
   and Applications 12. doi:10.1007/s001380050120
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.camera import CameraModel, StereoCalibration
from cdff_common.errors import InputError

FloatArray = NDArray[np.float64]

#: Pairs of maps that are kept: 1920 x 1200 pixels take 14 MB.
_KEPT = 8
#: Points along each side of an image from which its outline in the ideal camera is taken.
_OUTLINE = 64
#: Decimals, metres and of the rotation, up to which two places of the right camera are one. Where both cameras sit on a
#: mast that turns, their place to each other comes out of two poses and differs in its last bits from turn to turn.
_DECIMALS = 9


@dataclass(frozen=True, slots=True, eq=False)
class Rectified:
    """An ideal camera and where its pixels come from.

    Attributes
    ----------
    camera : CameraModel
        Without distortion.
    R : ndarray, shape (3, 3)
        Turns coordinates of the real camera into those of the ideal one.
    maps : tuple of ndarray
        OpenCV's fixed-point maps.
    """

    camera: CameraModel
    R: FloatArray
    maps: tuple[NDArray[Any], NDArray[Any]]

    def apply(self, image: NDArray[Any], interpolation: int = cv2.INTER_LINEAR) -> NDArray[Any]:
        """The image of the ideal camera; 0 where the real one saw nothing. Raises InputError for another size."""
        if (self.camera.rows, self.camera.cols) != image.shape[:2]:
            size = f"{self.camera.rows} x {self.camera.cols}"
            raise InputError(f"image of {image.shape[0]} x {image.shape[1]} pixels, its calibration is for {size}")
        return np.asarray(cv2.remap(image, *self.maps, interpolation))


@lru_cache(maxsize=_KEPT)
def undistorted(camera: CameraModel, keep: float) -> Rectified:
    """The ideal camera that looks where ``camera`` does.

    Parameters
    ----------
    camera : CameraModel
        With its size.
    keep : float
        0 zooms in until every pixel is seen, 1 zooms out until nothing is lost, between them in proportion.

    Raises
    ------
    InputError
        If the size is unknown, or the lens sees too far to the side for a flat image.
    """
    bounds = _bounds(camera, np.eye(3))
    return _made(camera, np.eye(3), _placed(camera, [bounds], keep)[0])


@dataclass(frozen=True, slots=True)
class _Placed:
    """Where the left camera is seen from the right one; equal and hashed as ``rounded``."""

    rounded: bytes
    T_right_left: FloatArray = field(compare=False)

    @classmethod
    def of(cls, T_right_left: FloatArray) -> _Placed:
        # Adding 0 makes -0 a 0.
        return cls((np.round(T_right_left, _DECIMALS) + 0.0).tobytes(), T_right_left)


@lru_cache(maxsize=_KEPT)
def _rectified(left: CameraModel, right: CameraModel, at: _Placed, keep: float) -> tuple[Rectified, Rectified, float]:
    T_right_left = at.T_right_left
    R_left, R_right = _turned_together(T_right_left)
    bounds = [_bounds(left, R_left), _bounds(right, R_right)]
    ideal = _placed(left, bounds, keep)
    pair = [_made(c, R, i) for c, R, i in zip((left, right), (R_left, R_right), ideal, strict=True)]
    return pair[0], pair[1], float(np.linalg.norm(T_right_left[:3, 3]))


def rectified(stereo: StereoCalibration, keep: float = 0.0) -> tuple[Rectified, Rectified, float]:
    """Two equal ideal cameras, the right one straight to the right of the left one, and the baseline, metres.

    Both are turned by half of what they differ by, then onto the baseline, so that both images are bent alike [2]_.
    ``keep`` as of ``undistorted``, for both images together.

    Raises
    ------
    InputError
        If sizes are unknown or differ, the right camera is not beside the left one, or they see nothing in common.
    """
    if (stereo.left.rows, stereo.left.cols) != (stereo.right.rows, stereo.right.cols):
        raise InputError("stereo pair: left and right image differ in size, expected one size")
    return _rectified(stereo.left, stereo.right, _Placed.of(stereo.T_right_left), keep)


def _turned_together(T_right_left: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations of the left and the right camera that make them look the same way, across the baseline."""
    half, _ = cv2.Rodrigues(cv2.Rodrigues(T_right_left[:3, :3])[0] * 0.5)
    # In the camera halfway between: where the right camera is.
    to_right = -half.T @ T_right_left[:3, 3]
    x = to_right / np.linalg.norm(to_right)
    if x[0] < 0.5:
        raise InputError(f"right camera at {to_right.round(3).tolist()} m of the left one: expected to its right (x)")
    z = np.cross(x, [0.0, 1.0, 0.0])
    z /= np.linalg.norm(z)
    R = np.stack([x, np.cross(z, x), z])
    return R @ half, R @ half.T


def _bounds(camera: CameraModel, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inner and outer box ``(xmin, ymin, xmax, ymax)`` of what a camera sees, on the turned camera's plane z = 1."""
    if not camera.rows or not camera.cols:
        raise InputError("camera without an image size: its calibration does not say it")
    u, v = np.linspace(0.0, camera.cols - 1.0, _OUTLINE), np.linspace(0.0, camera.rows - 1.0, _OUTLINE)
    sides = []
    for pixels in (
        np.column_stack([np.zeros_like(v), v]),
        np.column_stack([u, np.zeros_like(u)]),
        np.column_stack([np.full_like(v, camera.cols - 1.0), v]),
        np.column_stack([u, np.full_like(u, camera.rows - 1.0)]),
    ):
        rays = camera.rays(pixels) @ R.T
        if not (rays[:, 2] > 0.1).all():
            raise InputError("the lens sees too far to the side for a flat image; cut or resize the image before")
        sides.append(rays[:, :2] / rays[:, 2:])
    left, top, right, bottom = sides
    inner = np.array([left[:, 0].max(), top[:, 1].max(), right[:, 0].min(), bottom[:, 1].min()])
    outer = np.array([left[:, 0].min(), top[:, 1].min(), right[:, 0].max(), bottom[:, 1].max()])
    return inner, outer


def _placed(camera: CameraModel, bounds: list[tuple[FloatArray, FloatArray]], keep: float) -> list[CameraModel]:
    """Ideal cameras of one focal length and one row of the horizon, each centred on what it sees."""
    inner, outer = (np.array(boxes) for boxes in zip(*bounds, strict=True))
    seen = np.array([inner[:, 1].max(), inner[:, 3].min(), (inner[:, 2] - inner[:, 0]).min()])
    whole = np.array([outer[:, 1].min(), outer[:, 3].max(), (outer[:, 2] - outer[:, 0]).max()])
    if seen[2] <= 0.0 or seen[1] <= seen[0]:
        raise InputError("the cameras see nothing in common: no rectified image holds both")
    cols, rows = camera.cols - 1, camera.rows - 1
    zoomed_in = max(cols / seen[2], rows / (seen[1] - seen[0]))
    zoomed_out = min(cols / whole[2], rows / (whole[1] - whole[0]))
    f = float((1.0 - keep) * zoomed_in + keep * zoomed_out)
    y0, y1, _ = (1.0 - keep) * seen + keep * whole
    ideal = []
    for box in (1.0 - keep) * inner + keep * outer:
        cx, cy = cols / 2 - f * (box[0] + box[2]) / 2, rows / 2 - f * (y0 + y1) / 2
        ideal.append(CameraModel(camera.rows, camera.cols, f, f, float(cx), float(cy)))
    # One principal point: then disparity 0 is at infinity, as everything after it takes for granted.
    cx = float(np.mean([i.cx for i in ideal]))
    return [replace(i, cx=cx) for i in ideal]


def _made(camera: CameraModel, R: FloatArray, ideal: CameraModel) -> Rectified:
    cols, rows = np.meshgrid(np.arange(ideal.cols, dtype=np.float64), np.arange(ideal.rows, dtype=np.float64))
    x, y = (cols.ravel() - ideal.cx) / ideal.fx, (rows.ravel() - ideal.cy) / ideal.fy
    rays = np.column_stack([x, y, np.ones(cols.size)])
    pixels = np.nan_to_num(camera.project(rays @ R), nan=-1e4).reshape(*cols.shape, 2)
    maps = cv2.convertMaps(pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32), cv2.CV_16SC2)
    return Rectified(ideal, R, (maps[0], maps[1]))
