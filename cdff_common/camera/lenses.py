# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lens models: normalised image coordinates of points in the camera frame, and their inverse.

=================  ============================================  ====================================
lens               coefficients                                  tested against
=================  ============================================  ====================================
pinhole            ``k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4]]]``  OpenCV ``projectPoints`` [1]_
fisheye            ``k1 k2 k3 k4``                               OpenCV ``fisheye`` [2]_
omnidirectional    ``xi [k1 k2 p1 p2]``                          OpenCV ``omnidir`` [3]_
fov                ``omega``                                     COLMAP ``FOV`` [4]_
division           ``lambda``                                    COLMAP ``DIVISION`` [5]_
=================  ============================================  ====================================

References
----------
.. [1] Brown, D. C. (1971). Close-range camera calibration. Photogrammetric Engineering 37(8).
.. [2] Kannala, J., Brandt, S. S. (2006). A generic camera model and calibration method for conventional,
   wide-angle, and fish-eye lenses. IEEE TPAMI 28(8). doi:10.1109/TPAMI.2006.153
.. [3] Mei, C., Rives, P. (2007). Single view point omnidirectional camera calibration from planar grids.
   ICRA. doi:10.1109/ROBOT.2007.364084
.. [4] Devernay, F., Faugeras, O. (2001). Straight lines have to be straight. Machine Vision and Applications
   13. doi:10.1007/PL00013269
.. [5] Fitzgibbon, A. W. (2001). Simultaneous linear estimation of multiple view geometry and lens distortion.
   CVPR. doi:10.1109/CVPR.2001.990465
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
LensName = Literal["pinhole", "fisheye", "omnidirectional", "fov", "division"]

#: Largest number of Newton steps that invert a distortion.
_ITERATIONS = 50
#: Numbers of coefficients of the pinhole, in the order of OpenCV.
PINHOLE_COEFFICIENTS = (0, 4, 5, 8, 12)


@dataclass(frozen=True, slots=True)
class Lens:
    """Lens model.

    Attributes
    ----------
    counts : tuple of int
        Valid numbers of coefficients.
    normalised : callable
        ``(x, y, z, coefficients) -> (u, v, is_visible)``: coordinates on the image plane with focal length 1.
    rays : callable
        ``(u, v, coefficients) -> (n, 3)``: directions of any length; may be wrong outside the image circle.
    """

    counts: tuple[int, ...]
    normalised: Callable[
        [FloatArray, FloatArray, FloatArray, Sequence[float]],
        tuple[FloatArray, FloatArray, NDArray[np.bool_]],
    ]
    rays: Callable[[FloatArray, FloatArray, Sequence[float]], FloatArray]


def _pinhole(
    x: FloatArray, y: FloatArray, z: FloatArray, coefficients: Sequence[float]
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    with np.errstate(invalid="ignore", divide="ignore"):
        u, v = distort(x / z, y / z, coefficients)
    return u, v, z > 0.0


def _pinhole_rays(u: FloatArray, v: FloatArray, coefficients: Sequence[float]) -> FloatArray:
    x, y = undistort(u, v, coefficients)
    return np.column_stack([x, y, np.ones_like(x)])


def distort(x: FloatArray, y: FloatArray, coefficients: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Return distorted coordinates of points (x, y) on the plane z = 1, by the rational model of OpenCV."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = (*coefficients, *[0.0] * (12 - len(coefficients)))
    r2 = x * x + y * y
    radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + r2 * s2)
    v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + r2 * s4)
    return u, v


def undistort(u: FloatArray, v: FloatArray, coefficients: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Invert ``distort`` by Newton's method with the numeric derivative of the lens model."""
    x, y = u.copy(), v.copy()
    if not any(coefficients):
        return x, y
    h = 1e-7
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            fu, fv = distort(x, y, coefficients)
            du, dv = u - fu, v - fv
            if np.nanmax(np.abs([du, dv]), initial=0.0) < 1e-14:
                break
            a, c = ((g - f) / h for g, f in zip(distort(x + h, y, coefficients), (fu, fv), strict=True))
            b, d = ((g - f) / h for g, f in zip(distort(x, y + h, coefficients), (fu, fv), strict=True))
            determinant = a * d - b * c
            x, y = x + (d * du - b * dv) / determinant, y + (a * dv - c * du) / determinant
    return x, y


def _fisheye(
    x: FloatArray, y: FloatArray, z: FloatArray, coefficients: Sequence[float]
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    planar = np.hypot(x, y)
    theta = np.arctan2(planar, z)
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.where(planar > 0.0, _fisheye_radius(theta, coefficients) / planar, 1.0)
    return x * scale, y * scale, (planar > 0.0) | (z > 0.0)


def _fisheye_rays(u: FloatArray, v: FloatArray, coefficients: Sequence[float]) -> FloatArray:
    radius = np.hypot(u, v)
    theta = _fisheye_angle(radius, coefficients)
    with np.errstate(invalid="ignore", divide="ignore"):
        sine = np.where(radius > 0.0, np.sin(theta) / radius, 1.0)
    return np.column_stack([u * sine, v * sine, np.cos(theta)])


def _fisheye_radius(theta: FloatArray, coefficients: Sequence[float]) -> FloatArray:
    k1, k2, k3, k4 = coefficients or (0.0, 0.0, 0.0, 0.0)
    t2 = theta * theta
    return np.asarray(theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))))


def _fisheye_angle(radius: FloatArray, coefficients: Sequence[float]) -> FloatArray:
    """Invert ``_fisheye_radius`` on its increasing part, up to pi."""
    k1, k2, k3, k4 = coefficients or (0.0, 0.0, 0.0, 0.0)
    theta = np.minimum(radius, np.pi)
    for _ in range(_ITERATIONS):
        t2 = theta * theta
        slope = 1.0 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
        step = (_fisheye_radius(theta, coefficients) - radius) / np.where(slope > 1e-3, slope, 1e-3)
        theta = np.clip(theta - step, 0.0, np.pi)
        if np.abs(step).max(initial=0.0) < 1e-14:
            break
    return np.asarray(theta)


def _omnidirectional(
    x: FloatArray, y: FloatArray, z: FloatArray, coefficients: Sequence[float]
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Project on the unit sphere, then from the point ``xi`` behind its centre [3]_."""
    xi = coefficients[0]
    norm = np.sqrt(x * x + y * y + z * z)
    # Beyond this angle two points of the sphere have the same image.
    limit = -xi if xi <= 1.0 else -1.0 / xi
    with np.errstate(invalid="ignore", divide="ignore"):
        depth = z + xi * norm
        u, v = distort(x / depth, y / depth, coefficients[1:])
    return u, v, (norm > 0.0) & (z > limit * norm)


def _omnidirectional_rays(u: FloatArray, v: FloatArray, coefficients: Sequence[float]) -> FloatArray:
    xi = coefficients[0]
    x, y = undistort(u, v, coefficients[1:])
    r2 = x * x + y * y
    with np.errstate(invalid="ignore"):
        factor = (xi + np.sqrt(1.0 + (1.0 - xi * xi) * r2)) / (1.0 + r2)
    return np.column_stack([factor * x, factor * y, factor - xi])


def _fov(
    x: FloatArray, y: FloatArray, z: FloatArray, coefficients: Sequence[float]
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """The image radius is proportional to an angle: ``r_d = atan(2 r_u tan(w / 2)) / w`` [4]_."""
    (omega,) = coefficients
    slope = 2.0 * np.tan(omega / 2.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        u, v = x / z, y / z
        radius = np.hypot(u, v)
        scale = np.where(radius > 0.0, np.arctan(slope * radius) / (omega * radius), slope / omega)
    return u * scale, v * scale, z > 0.0


def _fov_rays(u: FloatArray, v: FloatArray, coefficients: Sequence[float]) -> FloatArray:
    (omega,) = coefficients
    slope = 2.0 * np.tan(omega / 2.0)
    radius = np.hypot(u, v)
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.where(radius > 0.0, np.tan(omega * radius) / (slope * radius), omega / slope)
    return np.column_stack([u * scale, v * scale, np.ones_like(u)])


def _division(
    x: FloatArray, y: FloatArray, z: FloatArray, coefficients: Sequence[float]
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Solve ``p_u = p_d / (1 + lambda r_d^2)`` for p_d [5]_."""
    (k,) = coefficients
    with np.errstate(invalid="ignore", divide="ignore"):
        u, v = x / z, y / z
        root = 1.0 - 4.0 * k * (u * u + v * v)
        scale = 2.0 / (1.0 + np.sqrt(root))
    return u * scale, v * scale, (z > 0.0) & (root >= 0.0)


def _division_rays(u: FloatArray, v: FloatArray, coefficients: Sequence[float]) -> FloatArray:
    (k,) = coefficients
    return np.column_stack([u, v, 1.0 + k * (u * u + v * v)])


#: Lens models by name.
LENSES: dict[LensName, Lens] = {
    "pinhole": Lens(PINHOLE_COEFFICIENTS, _pinhole, _pinhole_rays),
    "fisheye": Lens((0, 4), _fisheye, _fisheye_rays),
    "omnidirectional": Lens((1, 5), _omnidirectional, _omnidirectional_rays),
    "fov": Lens((1,), _fov, _fov_rays),
    "division": Lens((1,), _division, _division_rays),
}
