# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calibration of a stereo pair."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.camera.model import CameraModel
from cdff_common.errors import InputError
from cdff_common.geometry import se3

FloatArray = NDArray[np.float64]

#: Largest deviation of a file's matrix from a rotation, since files contain few digits.
_ROTATION_TOLERANCE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class StereoCalibration:
    """Left and right camera, and the pose of the left camera in the right camera frame.

    Attributes
    ----------
    left, right : CameraModel
    T_right_left : ndarray, shape (4, 4)
        Maps coordinates in the left camera frame to the right camera frame, metres.
    """

    left: CameraModel
    right: CameraModel
    T_right_left: FloatArray = field(repr=False)

    @classmethod
    def from_parts(
        cls, left: CameraModel, right: CameraModel, rotation: ArrayLike, translation_m: ArrayLike
    ) -> StereoCalibration:
        """Return the calibration of rotation ``(3, 3)`` and translation ``(3,)`` of T_right_left; R is
        orthonormalised.

        Raises
        ------
        InputError
            If the matrix is not a rotation, or the baseline is zero.
        """
        R, t = np.asarray(rotation, dtype=np.float64), np.asarray(translation_m, dtype=np.float64).reshape(-1)
        if R.shape != (3, 3) or t.shape != (3,) or not (np.isfinite(R).all() and np.isfinite(t).all()):
            raise InputError(
                f"stereo calibration: rotation {R.shape}, translation {t.shape}: expected finite 3x3, 3"
            )
        U, _, Vt = np.linalg.svd(R)
        nearest = U @ Vt
        if np.linalg.det(nearest) < 0 or np.abs(nearest - R).max() > _ROTATION_TOLERANCE:
            raise InputError(f"stereo calibration: {R.tolist()} is not a rotation")
        if not np.linalg.norm(t) > 0:
            raise InputError("stereo calibration: baseline 0 m, expected above 0 m")
        T = se3.transform(nearest, t)
        T.flags.writeable = False
        return cls(left, right, T)

    @property
    def baseline_m(self) -> float:
        """Distance of the cameras, metres."""
        return float(np.linalg.norm(self.T_right_left[:3, 3]))

    @property
    def is_rectified(self) -> bool:
        """True if a point has the same row in both images: equal ideal cameras, displaced along x only."""
        T, a, b = self.T_right_left, self.left, self.right
        rotation, offset = np.abs(T[:3, :3] - np.eye(3)).max(), np.abs(T[1:3, 3]).max()
        aligned = rotation < 1e-9 and offset < 1e-9 and T[0, 3] < 0
        return bool(aligned and a.is_ideal and b.is_ideal and (a.fx, a.fy, a.cy) == (b.fx, b.fy, b.cy))
