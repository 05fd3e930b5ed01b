# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Camera model: projection of points and back-projection of pixels, for the lenses of ``lenses``.

The camera frame is x right, y down, z forward. Pixel centres have integer coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.camera.lenses import LENSES, PINHOLE_COEFFICIENTS, LensName
from cdff_common.errors import InputError
from cdff_common.types import Frame, FrameCameraModelT

__all__ = ["PINHOLE_COEFFICIENTS", "CameraModel", "LensName"]

FloatArray = NDArray[np.float64]

#: Largest reprojection error of the ray computed for a pixel, pixels; above it, the ray is NaN.
_MAX_RAY_ERROR_PX = 1e-6
#: Lenses whose value of ``Frame-cameraModel-t`` is cam-MAPS: the first coefficient is the number of the lens.
_NUMBERED: tuple[LensName, ...] = ("omnidirectional", "fov", "division")


@dataclass(frozen=True, slots=True)
class CameraModel:
    """Intrinsic parameters of one camera.

    Attributes
    ----------
    rows, cols : int
        Size of the image, pixels; 0 if unknown.
    fx, fy, cx, cy : float
        Focal lengths and principal point, pixels.
    distortion : tuple of float
        Coefficients of the lens, in the order of ``lenses``.
    lens : str
        Name of the lens model: pinhole, fisheye, omnidirectional, fov or division.
    """

    rows: int
    cols: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    lens: LensName = "pinhole"

    def __post_init__(self) -> None:
        if not (np.isfinite([self.fx, self.fy, self.cx, self.cy]).all() and self.fx > 0 and self.fy > 0):
            raise InputError(
                f"camera fx={self.fx} fy={self.fy} cx={self.cx} cy={self.cy}: expected finite, fx, fy > 0"
            )
        if self.lens not in LENSES:
            raise InputError(f"lens {self.lens!r}: expected one of {', '.join(LENSES)}")
        valid_counts = LENSES[self.lens].counts
        if len(self.distortion) not in valid_counts or not np.isfinite(self.distortion).all():
            counts = ", ".join(map(str, valid_counts))
            raise InputError(
                f"{self.lens} distortion {list(self.distortion)}: expected {counts} finite coefficients"
            )
        if self.lens == "omnidirectional" and self.distortion[0] < 0.0:
            raise InputError(f"omnidirectional lens with xi {self.distortion[0]}: expected at least 0")
        if self.lens == "fov" and not 0.0 < self.distortion[0] < np.pi:
            raise InputError(f"fov lens with omega {self.distortion[0]}: expected between 0 and pi")

    @classmethod
    def from_matrix(
        cls,
        matrix: ArrayLike,
        distortion: ArrayLike = (),
        *,
        rows: int = 0,
        cols: int = 0,
        lens: LensName = "pinhole",
    ) -> CameraModel:
        """Return the model of a 3x3 camera matrix; superfluous trailing zeros of the coefficients are
        removed.

        Raises
        ------
        InputError
            If the matrix has skew or is not a camera matrix, or the number of coefficients is unknown.
        """
        K = np.asarray(matrix, dtype=np.float64)
        if K.shape != (3, 3) or abs(K[0, 1]) > 1e-9 * abs(K[0, 0]) or K[2, 2] != 1.0:
            raise InputError(f"camera matrix {K.tolist()}: expected 3x3 without skew, last element 1")
        coefficients = [float(v) for v in np.asarray(distortion, dtype=np.float64).reshape(-1)]
        valid_counts = LENSES[lens].counts if lens in LENSES else ()
        if 0 in valid_counts and not any(coefficients):
            coefficients = []
        while coefficients and coefficients[-1] == 0.0 and len(coefficients) not in valid_counts:
            coefficients.pop()
        return cls(
            rows,
            cols,
            float(K[0, 0]),
            float(K[1, 1]),
            float(K[0, 2]),
            float(K[1, 2]),
            tuple(coefficients),
            lens,
        )

    @classmethod
    def of_frame(cls, frame: Frame) -> CameraModel:
        """Return the camera model of an image; raises InputError if the image does not contain it."""
        rows, cols = frame.image.shape[:2]
        lens, coefficients = _lens_of_message(frame)
        return cls.from_matrix(frame.camera_matrix, coefficients, rows=rows, cols=cols, lens=lens)

    @property
    def message_model(self) -> FrameCameraModelT:
        """Camera model of the message of an image, ``Frame-cameraModel-t``."""
        if self.lens == "pinhole":
            return FrameCameraModelT.CAM_PINHOLE
        return FrameCameraModelT.CAM_FISHEYE if self.lens == "fisheye" else FrameCameraModelT.CAM_MAPS

    @property
    def message_coefficients(self) -> FloatArray:
        """Coefficients ``distCoeffs`` of the message of an image, which ``of_frame`` reads."""
        number = [_NUMBERED.index(self.lens) + 1] if self.lens in _NUMBERED else []
        return np.array([*number, *self.distortion], dtype=np.float64)

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix ``(3, 3)``, pixels."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def is_ideal(self) -> bool:
        """True for a pinhole without distortion."""
        return self.lens == "pinhole" and not any(self.distortion)

    def project(self, points_m: ArrayLike) -> FloatArray:
        """Return the pixels ``(n, 2)`` of points ``(n, 3)`` in the camera frame; NaN for invisible points.

        A point is visible to a pinhole, fov or division lens if z > 0, to a fisheye unless it is exactly
        behind the camera, to an omnidirectional lens where the image of the sphere is unique.
        """
        x, y, z = np.asarray(points_m, dtype=np.float64).reshape(-1, 3).T
        u, v, is_visible = LENSES[self.lens].normalised(x, y, z, self.distortion)
        pixels = np.column_stack([self.fx * u + self.cx, self.fy * v + self.cy])
        pixels[~is_visible] = np.nan
        return pixels

    def rays(self, pixels: ArrayLike) -> FloatArray:
        """Return the unit ray directions ``(n, 3)`` in the camera frame of pixels ``(n, 2)``; NaN where
        undefined.
        """
        targets_px = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        u, v = (targets_px[:, 0] - self.cx) / self.fx, (targets_px[:, 1] - self.cy) / self.fy
        rays = LENSES[self.lens].rays(u, v, self.distortion)
        with np.errstate(invalid="ignore"):
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        error = np.abs(self.project(rays) - targets_px).max(axis=1, initial=0.0)
        rays[~(error <= _MAX_RAY_ERROR_PX * max(self.fx, self.fy))] = np.nan
        return rays


def _lens_of_message(frame: Frame) -> tuple[LensName, FloatArray]:
    """Return the lens of an image and its coefficients; raises InputError if the image has no camera."""
    model, coefficients = frame.intrinsic.camera_model, frame.intrinsic.dist_coeffs
    if model is FrameCameraModelT.CAM_PINHOLE:
        return "pinhole", coefficients
    if model is FrameCameraModelT.CAM_FISHEYE:
        return "fisheye", coefficients
    numbers = [n + 1.0 for n in range(len(_NUMBERED))]
    if model is FrameCameraModelT.CAM_MAPS and len(coefficients) and coefficients[0] in numbers:
        return _NUMBERED[int(coefficients[0]) - 1], coefficients[1:]
    raise InputError(
        f"image of {frame.frame or 'a camera'}: {model.name}, expected a pinhole, fisheye, omnidirectional, "
        "fov or division camera; state the calibration, for a log by --calibration FILE"
    )
