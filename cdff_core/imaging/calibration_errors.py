# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Effect of calibration and tracking errors of a stereo camera on the measurements ``(u, v, d)``."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.imaging.rectified_camera import RectifiedCamera


class CalibrationUncertainty(DfnConfig):
    """Standard deviations of calibration errors, which are constant over a drive.

    The defaults are assumptions: a careful calibration with a printed target, some months old. Replace them
    by the values of the calibration report of the camera; 0 means that a parameter is exact.
    """

    focal_length_ratio: Annotated[
        float, Field(ge=0, le=0.2, description="Relative error of the focal length")
    ] = 0.005
    baseline_ratio: Annotated[float, Field(ge=0, le=0.2, description="Relative error of the baseline")] = (
        0.005
    )
    principal_point_px: Annotated[
        float, Field(ge=0, le=50, description="Error of the column and of the row of the principal point")
    ] = 1.0
    rotation_deg: Annotated[
        float,
        Field(
            ge=0,
            le=5,
            description="Error of the rotation between the cameras about the optical axis and the baseline",
        ),
    ] = 0.03
    distortion_px: Annotated[
        float,
        Field(ge=0, le=20, description="Residual radial distortion of each camera in the image corner"),
    ] = 0.3

    def sigmas(self) -> FloatArray:
        """Return the standard deviations (8,) in the order and units of ``measurement_errors``."""
        return np.array(
            [
                self.focal_length_ratio,
                self.baseline_ratio,
                *[self.principal_point_px] * 2,
                *[float(np.radians(self.rotation_deg))] * 2,
                *[self.distortion_px] * 2,
            ]
        )


def corner_radius_px(camera: RectifiedCamera, *measurements: FloatArray) -> float:
    """Return the distance of the image corner from the principal point, pixels, at least 1.

    It is that of the first pixel, or that of the farthest measurement (n, 3) if the principal point is not in
    the middle of the image, as after cropping.
    """
    pixels = np.concatenate([np.zeros((1, 2)), *(uvd[:, :2] for uvd in measurements)])
    return float(np.hypot(*(pixels - [camera.cx, camera.cy]).T).max(initial=1.0))


def measurement_errors(camera: RectifiedCamera, uvd: FloatArray, corner_px: float) -> FloatArray:
    """Return the derivatives (n, 3, 8) of measurements with respect to the calibration errors.

    Parameters
    ----------
    camera : RectifiedCamera
    uvd : FloatArray, shape (n, 3)
        Columns, rows and disparities, pixels.
    corner_px : float
        Distance of the image corner from the principal point, pixels.

    Returns
    -------
    FloatArray, shape (n, 3, 8)
        Pixels per unit of: focal length and baseline (relative), column and row of the principal point (px),
        rotations of the right camera about the optical axis and the baseline (rad), radial distortion of the
        left and the right camera (px in the corner). The rotation about the vertical is not included: it
        offsets the disparities, and this offset is estimated with the motion.
    """
    u, v, d = (uvd - [camera.cx, camera.cy, 0.0]).T
    y, u_right = v / camera.fy, u - d
    left_ratio, right_ratio = ((column**2 + v**2) / corner_px**3 for column in (u, u_right))
    errors = np.zeros((len(uvd), 3, 8))
    errors[:, :, 0] = np.column_stack([u, v, d])
    errors[:, 2, 1] = d
    errors[:, 0, 2] = errors[:, 1, 3] = 1.0
    errors[:, 2, 4] = camera.fx * y
    errors[:, 2, 5] = u_right * y
    errors[:, :, 6] = np.column_stack([u, v, u]) * left_ratio[:, None]
    errors[:, 2, 7] = -u_right * right_ratio
    return errors


def tracking_errors(reference: FloatArray) -> FloatArray:
    """Return the errors ``(n, 3, 6)`` of ``u, v, d`` common to all points: offsets of column, row and
    disparity, magnification, stretch of rows, and rotation of the image.

    The rows can be stretched alone, because patches of the ground ahead grow more in height than in width
    when the camera approaches them.
    """
    modes = np.zeros((len(reference), 3, 6))
    modes[:, 0, 0] = modes[:, 1, 1] = modes[:, 2, 2] = 1.0
    centred = reference[:, :2] - reference[:, :2].mean(axis=0)
    centred /= np.maximum(np.sqrt(np.mean(centred**2, axis=0)), 1.0)
    modes[:, :2, 3] = centred
    modes[:, 1, 4] = centred[:, 1]
    modes[:, :2, 5] = centred[:, ::-1] * [-1.0, 1.0]
    return modes
