# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loop over points; single-threaded, so that replay does not depend on the number of threads."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry.small_vectors import cross, rotated


@njit(cache=True)
def deskew(
    points: FloatArray,
    interval: IntArray,
    fraction: FloatArray,
    R_fixed_sensor: FloatArray,
    t_fixed_sensor: FloatArray,
    rotations: FloatArray,
    cov: FloatArray,
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Return the points in the fixed frame (n, 3) and the variances of their z (n,).

    Point i is transformed by the pose at the fraction f = ``fraction[i]`` between pose k = ``interval[i]``
    and pose k + 1. Its rotation is ``R_fixed_sensor[k] Exp(f rotations[k])`` (Rodrigues' formula), where
    ``rotations`` are the rotation vectors from pose k to pose k + 1; translation and covariance are
    interpolated linearly. The variance of z is ``J C J^T`` with J = [0 0 1 y -x 0] for the lever arm (x, y)
    of the point in the fixed frame.
    """
    fixed, variance = np.empty((len(points), 3)), np.empty(len(points))
    for i in range(len(points)):
        k, f = interval[i], fraction[i]
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        wx, wy, wz = f * rotations[k, 0], f * rotations[k, 1], f * rotations[k, 2]
        a2 = wx * wx + wy * wy + wz * wz
        if a2 > 1e-16:
            a = math.sqrt(a2)
            s, c = math.sin(a) / a, (1.0 - math.cos(a)) / a2
        else:
            s, c = 1.0, 0.5
        cx, cy, cz = cross(wx, wy, wz, px, py, pz)
        dx, dy, dz = cross(wx, wy, wz, cx, cy, cz)
        qx, qy, qz = px + s * cx + c * dx, py + s * cy + c * dy, pz + s * cz + c * dz
        ax, ay, az = rotated(R_fixed_sensor[k], qx, qy, qz)
        g = 1.0 - f
        fixed[i, 0] = ax + g * t_fixed_sensor[k, 0] + f * t_fixed_sensor[k + 1, 0]
        fixed[i, 1] = ay + g * t_fixed_sensor[k, 1] + f * t_fixed_sensor[k + 1, 1]
        fixed[i, 2] = az + g * t_fixed_sensor[k, 2] + f * t_fixed_sensor[k + 1, 2]
        czz = g * cov[k, 2, 2] + f * cov[k + 1, 2, 2]
        czr = g * cov[k, 2, 3] + f * cov[k + 1, 2, 3]
        czp = g * cov[k, 2, 4] + f * cov[k + 1, 2, 4]
        crr = g * cov[k, 3, 3] + f * cov[k + 1, 3, 3]
        crp = g * cov[k, 3, 4] + f * cov[k + 1, 3, 4]
        cpp = g * cov[k, 4, 4] + f * cov[k + 1, 4, 4]
        v = czz + 2.0 * ay * czr - 2.0 * ax * czp + ay * ay * crr - 2.0 * ax * ay * crp + ax * ax * cpp
        variance[i] = 0.0 if v < 0.0 else v  # NaN (unknown covariance) is not changed
    return fixed, variance
