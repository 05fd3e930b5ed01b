# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A camera: points to pixels and pixels to rays, for pinhole lenses with distortion and for fisheyes.

The camera's frame is x right, y down, z forward. Pixel centres lie on whole numbers.

References
----------
.. [1] Brown, D. C. (1971). Close-range camera calibration. Photogrammetric Engineering 37(8).
.. [2] Kannala, J., Brandt, S. S. (2006). A generic camera model and calibration method for conventional, wide-angle,
   and fish-eye lenses. IEEE TPAMI 28(8). doi:10.1109/TPAMI.2006.153
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.types import Frame, FrameCameraModelT

FloatArray = NDArray[np.float64]

#: How many coefficients a pinhole may have: none, k1 k2 p1 p2, then k3, then k4 k5 k6, then s1 to s4, as OpenCV.
PINHOLE_COEFFICIENTS = (0, 4, 5, 8, 12)
#: The fisheye polynomial has k1 to k4, or none.
FISHEYE_COEFFICIENTS = (0, 4)
_ITERATIONS = 50
#: A pixel whose ray does not lead back to it within this much, pixels, has none.
_CLOSED_PX = 1e-6


@dataclass(frozen=True, slots=True)
class CameraModel:
    """Intrinsics of one camera.

    Attributes
    ----------
    rows, cols : int
        Size of the image, pixels; 0 where unknown.
    fx, fy, cx, cy : float
        Focal lengths and principal point, pixels.
    distortion : tuple of float
        Pinhole: ``k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4]]]`` [1]_. Fisheye: ``k1 k2 k3 k4`` [2]_.
    fisheye : bool
        Whether the radius in the image is a polynomial of the angle to the axis instead of its tangent.
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
            raise InputError(f"camera fx={self.fx} fy={self.fy} cx={self.cx} cy={self.cy}: expected finite, fx, fy > 0")
        known = FISHEYE_COEFFICIENTS if self.fisheye else PINHOLE_COEFFICIENTS
        if len(self.distortion) not in known or not np.isfinite(self.distortion).all():
            kind = "fisheye" if self.fisheye else "pinhole"
            counts = ", ".join(map(str, known))
            raise InputError(f"{kind} distortion {list(self.distortion)}: expected {counts} finite coefficients")

    @classmethod
    def from_matrix(
        cls, matrix: ArrayLike, distortion: ArrayLike = (), *, rows: int = 0, cols: int = 0, fisheye: bool = False
    ) -> CameraModel:
        """From a 3x3 camera matrix; trailing zeros that make up an odd number of coefficients are left out.

        Raises
        ------
        InputError
            If the matrix has skew or cannot be a camera's, or the coefficients are of no known number.
        """
        K = np.asarray(matrix, dtype=np.float64)
        if K.shape != (3, 3) or abs(K[0, 1]) > 1e-9 * abs(K[0, 0]) or K[2, 2] != 1.0:
            raise InputError(f"camera matrix {K.tolist()}: expected 3x3 without skew, last element 1")
        given = [float(v) for v in np.asarray(distortion, dtype=np.float64).reshape(-1)]
        known = FISHEYE_COEFFICIENTS if fisheye else PINHOLE_COEFFICIENTS
        while given and not any(given):
            given = []
        while given and given[-1] == 0.0 and len(given) not in known:
            given.pop()
        return cls(
            rows, cols, float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), tuple(given), fisheye
        )  # fmt: skip

    @classmethod
    def of_frame(cls, frame: Frame) -> CameraModel:
        """Camera of an image; raises InputError where the image does not say it."""
        model = frame.intrinsic.camera_model
        if model not in (FrameCameraModelT.CAM_PINHOLE, FrameCameraModelT.CAM_FISHEYE):
            raise InputError(
                f"image of {frame.frame or 'a camera'}: {model.name}, expected a pinhole or fisheye camera"
            )
        rows, cols = frame.image.shape[:2]
        return cls.from_matrix(
            frame.camera_matrix, frame.intrinsic.dist_coeffs, rows=rows, cols=cols,
            fisheye=model is FrameCameraModelT.CAM_FISHEYE,
        )  # fmt: skip

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix ``(3, 3)``, pixels."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def is_ideal(self) -> bool:
        """Whether straight lines stay straight."""
        return not self.fisheye and not any(self.distortion)

    def project(self, points_m: ArrayLike) -> FloatArray:
        """Pixels ``(n, 2)`` of points ``(n, 3)`` in the camera's frame; NaN for those that cannot be seen.

        A pinhole sees what has z above 0, a fisheye all but the point straight behind.
        """
        x, y, z = np.asarray(points_m, dtype=np.float64).reshape(-1, 3).T
        if self.fisheye:
            planar = np.hypot(x, y)
            theta = np.arctan2(planar, z)
            with np.errstate(invalid="ignore", divide="ignore"):
                scale = np.where(planar > 0.0, self._fisheye_radius(theta) / planar, 1.0)
            u, v = x * scale, y * scale
            seen = (planar > 0.0) | (z > 0.0)
        else:
            seen = z > 0.0
            with np.errstate(invalid="ignore", divide="ignore"):
                u, v = self._distorted(x / z, y / z)
        pixels = np.column_stack([self.fx * u + self.cx, self.fy * v + self.cy])
        pixels[~seen] = np.nan
        return pixels

    def rays(self, pixels: ArrayLike) -> FloatArray:
        """Unit directions ``(n, 3)`` in the camera's frame of pixels ``(n, 2)``; NaN where the lens shows nothing."""
        given = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        u, v = (given[:, 0] - self.cx) / self.fx, (given[:, 1] - self.cy) / self.fy
        if self.fisheye:
            radius = np.hypot(u, v)
            theta = self._fisheye_angle(radius)
            with np.errstate(invalid="ignore", divide="ignore"):
                sine = np.where(radius > 0.0, np.sin(theta) / radius, 1.0)
            rays = np.column_stack([u * sine, v * sine, np.cos(theta)])
        else:
            x, y = self._undistorted(u, v)
            rays = np.column_stack([x, y, np.ones_like(x)])
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        error = np.abs(self.project(rays) - given).max(axis=1, initial=0.0)
        rays[~(error <= _CLOSED_PX * max(self.fx, self.fy))] = np.nan
        return rays

    # -- lenses -----------------------------------------------------------------------------------------------------

    def _distorted(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = (*self.distortion, *[0.0] * (12 - len(self.distortion)))
        r2 = x * x + y * y
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + r2 * s2)
        v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + r2 * s4)
        return u, v

    def _undistorted(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Newton's method on both coordinates with the numeric derivative of the lens."""
        x, y = u.copy(), v.copy()
        if not any(self.distortion):
            return x, y
        h = 1e-7
        with np.errstate(all="ignore"):
            for _ in range(_ITERATIONS):
                fu, fv = self._distorted(x, y)
                du, dv = u - fu, v - fv
                if np.nanmax(np.abs([du, dv]), initial=0.0) < 1e-14:
                    break
                a, c = ((g - f) / h for g, f in zip(self._distorted(x + h, y), (fu, fv), strict=True))
                b, d = ((g - f) / h for g, f in zip(self._distorted(x, y + h), (fu, fv), strict=True))
                determinant = a * d - b * c
                x, y = x + (d * du - b * dv) / determinant, y + (a * dv - c * du) / determinant
        return x, y

    def _fisheye_radius(self, theta: FloatArray) -> FloatArray:
        k1, k2, k3, k4 = self.distortion or (0.0, 0.0, 0.0, 0.0)
        t2 = theta * theta
        return np.asarray(theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))))

    def _fisheye_angle(self, radius: FloatArray) -> FloatArray:
        """Inverse of ``_fisheye_radius`` where it grows, up to straight behind."""
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
