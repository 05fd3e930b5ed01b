# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled sums of the normal equations of point-to-plane registration."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def normal_equations(
    offset_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    residual_m: NDArray[np.float64],
    weight: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sum the weighted Hessian and gradient of ``n . (p + t + phi x offset - q)``.

    Parameters
    ----------
    offset_m : ndarray, shape (n, 3)
        Moved source points from the centre of rotation, metres.
    normals : ndarray, shape (n, 3)
        Unit normals at the matched target points.
    residual_m : ndarray, shape (n,)
        ``n . (p - q)``, metres.
    weight : ndarray, shape (n,)

    Returns
    -------
    tuple of ndarray
        Hessian (6, 6) and gradient (6,) in the order ``[x y z rx ry rz]``.
    """
    H = np.zeros((6, 6))
    g = np.zeros(6)
    J = np.zeros(6)
    for i in range(offset_m.shape[0]):
        w = weight[i]
        if w <= 0.0:
            continue
        ox, oy, oz = offset_m[i, 0], offset_m[i, 1], offset_m[i, 2]
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        J[0], J[1], J[2] = nx, ny, nz
        J[3], J[4], J[5] = oy * nz - oz * ny, oz * nx - ox * nz, ox * ny - oy * nx
        for row in range(6):
            wj = w * J[row]
            g[row] += wj * residual_m[i]
            for column in range(row + 1):
                H[row, column] += wj * J[column]
    for row in range(6):
        for column in range(row):
            H[column, row] = H[row, column]
    return H, g
