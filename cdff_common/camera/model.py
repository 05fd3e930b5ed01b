# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Camera model: projection of points and back-projection of pixels, for pinhole and fisheye lenses.

The camera frame is x right, y down, z forward. Pixel centres have integer coordinates.

References
----------
.. [1] Brown, D. C. (1971). Close-range camera calibration. Photogrammetric Engineering 37(8).
.. [2] Kannala, J., Brandt, S. S. (2006). A generic camera model and calibration method for conventional,
   wide-angle, and fish-eye lenses. IEEE TPAMI 28(8). doi:10.1109/TPAMI.2006.153
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.types import Frame, FrameCameraModelT

FloatArray = NDArray[np.float64]

#: Valid numbers of pinhole coefficients: none, k1 k2 p1 p2, then k3, then k4 k5 k6, then s1 to s4, as in
#: OpenCV.
PINHOLE_COEFFICIENTS = (0, 4, 5, 8, 12)
#: The fisheye polynomial has k1 to k4, or none.
FISHEYE_COEFFICIENTS = (0, 4)
#: Largest number of Newton steps that invert a distortion.
_ITERATIONS = 50
#: Largest reprojection error of the ray computed for a pixel, pixels; above it, the ray is NaN.
_MAX_RAY_ERROR_PX = 1e-6


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
        Pinhole: ``k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4]]]`` [1]_. Fisheye: ``k1 k2 k3 k4`` [2]_.
    fisheye : bool
        True if the image radius is a polynomial of the angle to the optical axis instead of its tangent.
    """

    rows: int
    cols: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    fisheye: bool = False

    def __post_init__(self) -> None:
        if not (np.isfinite([self.fx, self.fy, self.cx, self.cy]).all() and self.fx > 0 and self.fy > 0):
            raise InputError(
                f"camera fx={self.fx} fy={self.fy} cx={self.cx} cy={self.cy}: expected finite, fx, fy > 0"
            )
        valid_counts = FISHEYE_COEFFICIENTS if self.fisheye else PINHOLE_COEFFICIENTS
        if len(self.distortion) not in valid_counts or not np.isfinite(self.distortion).all():
            kind = "fisheye" if self.fisheye else "pinhole"
            counts = ", ".join(map(str, valid_counts))
            raise InputError(
                f"{kind} distortion {list(self.distortion)}: expected {counts} finite coefficients"
            )

    @classmethod
    def from_matrix(
        cls,
        matrix: ArrayLike,
        distortion: ArrayLike = (),
        *,
        rows: int = 0,
        cols: int = 0,
        fisheye: bool = False,
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
        valid_counts = FISHEYE_COEFFICIENTS if fisheye else PINHOLE_COEFFICIENTS
        while coefficients and not any(coefficients):
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
            fisheye,
        )

    @classmethod
    def of_frame(cls, frame: Frame) -> CameraModel:
        """Return the camera model of an image; raises InputError if the image does not contain it."""
        model = frame.intrinsic.camera_model
        if model not in (FrameCameraModelT.CAM_PINHOLE, FrameCameraModelT.CAM_FISHEYE):
            raise InputError(
                f"image of {frame.frame or 'a camera'}: {model.name}, expected a pinhole or fisheye camera"
            )
        rows, cols = frame.image.shape[:2]
        return cls.from_matrix(
            frame.camera_matrix,
            frame.intrinsic.dist_coeffs,
            rows=rows,
            cols=cols,
            fisheye=model is FrameCameraModelT.CAM_FISHEYE,
        )

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix ``(3, 3)``, pixels."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def is_ideal(self) -> bool:
        """True for a pinhole without distortion."""
        return not self.fisheye and not any(self.distortion)

    def project(self, points_m: ArrayLike) -> FloatArray:
        """Return the pixels ``(n, 2)`` of points ``(n, 3)`` in the camera frame; NaN for invisible points.

        A point is visible to a pinhole if z > 0, to a fisheye unless it is exactly behind the camera.
        """
        x, y, z = np.asarray(points_m, dtype=np.float64).reshape(-1, 3).T
        if self.fisheye:
            planar = np.hypot(x, y)
            theta = np.arctan2(planar, z)
            with np.errstate(invalid="ignore", divide="ignore"):
                scale = np.where(planar > 0.0, self._fisheye_radius(theta) / planar, 1.0)
            u, v = x * scale, y * scale
            is_visible = (planar > 0.0) | (z > 0.0)
        else:
            is_visible = z > 0.0
            with np.errstate(invalid="ignore", divide="ignore"):
                u, v = self._distort(x / z, y / z)
        pixels = np.column_stack([self.fx * u + self.cx, self.fy * v + self.cy])
        pixels[~is_visible] = np.nan
        return pixels

    def rays(self, pixels: ArrayLike) -> FloatArray:
        """Return the unit ray directions ``(n, 3)`` in the camera frame of pixels ``(n, 2)``; NaN where
        undefined.
        """
        targets_px = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        u, v = (targets_px[:, 0] - self.cx) / self.fx, (targets_px[:, 1] - self.cy) / self.fy
        if self.fisheye:
            radius = np.hypot(u, v)
            theta = self._fisheye_angle(radius)
            with np.errstate(invalid="ignore", divide="ignore"):
                sine = np.where(radius > 0.0, np.sin(theta) / radius, 1.0)
            rays = np.column_stack([u * sine, v * sine, np.cos(theta)])
        else:
            x, y = self._undistort(u, v)
            rays = np.column_stack([x, y, np.ones_like(x)])
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        error = np.abs(self.project(rays) - targets_px).max(axis=1, initial=0.0)
        rays[~(error <= _MAX_RAY_ERROR_PX * max(self.fx, self.fy))] = np.nan
        return rays

    # -- lenses
    # -----------------------------------------------------------------------------------------------------

    def _distort(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return distorted coordinates of points (x, y) on the plane z = 1,
        by the rational model of OpenCV.
        """
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = (
            *self.distortion,
            *[0.0] * (12 - len(self.distortion)),
        )
        r2 = x * x + y * y
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + r2 * s2)
        v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + r2 * s4)
        return u, v

    def _undistort(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Invert the distortion by Newton's method with the numeric derivative of the lens model."""
        x, y = u.copy(), v.copy()
        if not any(self.distortion):
            return x, y
        h = 1e-7
        with np.errstate(all="ignore"):
            for _ in range(_ITERATIONS):
                fu, fv = self._distort(x, y)
                du, dv = u - fu, v - fv
                if np.nanmax(np.abs([du, dv]), initial=0.0) < 1e-14:
                    break
                a, c = ((g - f) / h for g, f in zip(self._distort(x + h, y), (fu, fv), strict=True))
                b, d = ((g - f) / h for g, f in zip(self._distort(x, y + h), (fu, fv), strict=True))
                determinant = a * d - b * c
                x, y = x + (d * du - b * dv) / determinant, y + (a * dv - c * du) / determinant
        return x, y

    def _fisheye_radius(self, theta: FloatArray) -> FloatArray:
        k1, k2, k3, k4 = self.distortion or (0.0, 0.0, 0.0, 0.0)
        t2 = theta * theta
        return np.asarray(theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))))

    def _fisheye_angle(self, radius: FloatArray) -> FloatArray:
        """Invert ``_fisheye_radius`` on its increasing part, up to pi."""
        k1, k2, k3, k4 = self.distortion or (0.0, 0.0, 0.0, 0.0)
        theta = np.minimum(radius, np.pi)
        for _ in range(_ITERATIONS):
            t2 = theta * theta
            slope = 1.0 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
            step = (self._fisheye_radius(theta) - radius) / np.where(slope > 1e-3, slope, 1e-3)
            theta = np.clip(theta - step, 0.0, np.pi)
            if np.abs(step).max(initial=0.0) < 1e-14:
                break
        return np.asarray(theta)
