# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rectified stereo camera: projection of points to ``(u, v, d)`` and triangulation, with derivatives.

The frame of the left camera is x right, y down, z forward. ``u, v`` are pixels of the left image; the
disparity is ``d = u - u_right = fx b / z``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError


@dataclass(frozen=True, slots=True)
class RectifiedCamera:
    """Intrinsics of the left camera, pixels, and the baseline, metres."""

    fx: float
    fy: float
    cx: float
    cy: float
    baseline_m: float

    @classmethod
    def from_matrix(cls, camera_matrix: ArrayLike, baseline_m: float) -> RectifiedCamera:
        """Return the camera of a 3x3 matrix and the baseline; raises InputError on invalid ones."""
        K = np.asarray(camera_matrix, dtype=np.float64)
        baseline = float(baseline_m)
        if K.shape != (3, 3) or not np.all(np.isfinite(K)) or K[0, 0] <= 0 or K[1, 1] <= 0:
            raise InputError(
                f"camera matrix {K.tolist()}: expected 3x3 with positive focal lengths in pixels"
            )
        if not np.isfinite(baseline) or baseline <= 0:
            raise InputError(
                f"baseline {baseline} m: expected above 0, the right camera to the right of the left"
            )
        return cls(float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), baseline)

    def triangulate(self, uvd: ArrayLike) -> FloatArray:
        """Return points ``(n, 3)``, metres, of measurements ``(n, 3)`` u, v, d in pixels, d above 0."""
        u, v, d = np.asarray(uvd, dtype=np.float64).T
        z = self.fx * self.baseline_m / d
        return np.column_stack([(u - self.cx) * z / self.fx, (v - self.cy) * z / self.fy, z])

    def project(self, points_m: ArrayLike) -> FloatArray:
        """Return measurements ``(n, 3)`` u, v, d in pixels of points ``(n, 3)``, metres, z not 0."""
        x, y, z = np.asarray(points_m, dtype=np.float64).T
        return np.column_stack(
            [self.fx * x / z + self.cx, self.fy * y / z + self.cy, self.fx * self.baseline_m / z]
        )

    def projection_jacobian(self, points_m: ArrayLike) -> FloatArray:
        """Return the derivatives ``(n, 3, 3)`` of ``project`` with respect to the point."""
        x, y, z = np.asarray(points_m, dtype=np.float64).T
        J = np.zeros((len(z), 3, 3))
        J[:, 0, 0], J[:, 0, 2] = self.fx / z, -self.fx * x / z**2
        J[:, 1, 1], J[:, 1, 2] = self.fy / z, -self.fy * y / z**2
        J[:, 2, 2] = -self.fx * self.baseline_m / z**2
        return J

    def triangulation_jacobian(self, uvd: ArrayLike) -> FloatArray:
        """Return the derivatives ``(n, 3, 3)`` of ``triangulate`` by u, v, d."""
        points = self.triangulate(uvd)
        d = np.asarray(uvd, dtype=np.float64)[:, 2]
        J = np.zeros((len(d), 3, 3))
        J[:, 0, 0], J[:, 1, 1] = points[:, 2] / self.fx, points[:, 2] / self.fy
        J[:, :, 2] = -points / d[:, None]
        return J
