# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Attitude of a camera at an image: directions of pixels and pixels of directions."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.camera import CameraModel
from cdff_common.geometry import se3
from cdff_core.bearing_tracking.lens import distort_directions, undistort_directions


@dataclass(frozen=True, slots=True, eq=False)
class CameraAttitude:
    """Attitude of the camera at an image.

    Attributes
    ----------
    rotation : ndarray (3, 3) or None
        R_inertial_camera; None if it is unknown.
    covariance : ndarray (3, 3)
        Covariance of its rotation vector in the inertial frame, square radians.
    stars : ndarray of bool (n,)
        Sources that are stars of the catalogue.
    is_from_stars : bool
    scale, radial : float
        Errors of the lens, see StarIdentification.
    residual_rad : float
        Root mean square of the angles between sources and stars; NaN without stars.
    reasons : tuple of str
        Restrictions of the attitude.
    inputs : tuple of str
        Ids of the samples.
    bias_rad : float
        Standard deviation of a constant error about each axis, which the differences of images do not show.
    lens_rad : float
        Standard deviation of a direction by the lens, which is the same in all images.
    """

    rotation: FloatArray | None
    covariance: FloatArray
    stars: BoolArray
    is_from_stars: bool = False
    scale: float = 1.0
    radial: float = 0.0
    residual_rad: float = float("nan")
    reasons: tuple[str, ...] = ()
    inputs: tuple[str, ...] = field(default=())
    bias_rad: float = 0.0
    lens_rad: float = 0.0

    def directions(self, camera: CameraModel, pixels: FloatArray) -> FloatArray:
        """Return the unit vectors (n, 3) of pixels (n, 2), inertial, or in the camera frame without an
        attitude.
        """
        rays = undistort_directions(camera.rays(pixels), self.scale, self.radial)
        return rays if self.rotation is None else rays @ self.rotation.T

    def pixels(self, camera: CameraModel, directions: FloatArray) -> FloatArray:
        """Return the pixels (n, 2) of directions (n, 3), the inverse of ``directions``; NaN behind the
        camera.
        """
        rays = directions if self.rotation is None else directions @ self.rotation
        return camera.project(distort_directions(rays, self.scale, self.radial))

    def covariances(
        self, camera: CameraModel, pixel_covariances: FloatArray, directions: FloatArray
    ) -> FloatArray:
        """Return the covariances (n, 3, 3) of directions: those of the pixels and of the attitude.

        A pixel is an angle of 1 / f near the optical axis; the small change towards the border is neglected.
        """
        R = np.eye(3) if self.rotation is None else self.rotation
        axes = R[:, :2]
        scale = np.diag([1.0 / camera.fx, 1.0 / camera.fy])
        covariances = np.asarray(axes @ (scale @ pixel_covariances @ scale) @ axes.T)
        if self.rotation is not None:
            turn = se3.skew(directions) if len(directions) else np.zeros((0, 3, 3))
            covariances = covariances + turn @ self.covariance @ np.swapaxes(turn, 1, 2)
        return covariances
