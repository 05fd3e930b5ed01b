# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Roughness of a surface at the spacing of its points."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray


def roughness_m(points_m: FloatArray, normals: FloatArray) -> float:
    """Return the robust standard deviation, metres, of distances of points from the plane of their nearest
    neighbour.

    It contains the noise of the points and the relief between neighbouring points.

    Parameters
    ----------
    points_m : ndarray, shape (n, 3)
        At least two points, metres.
    normals : ndarray, shape (n, 3)
        Unit normals.
    """
    from cdff_common.geometry.kdtree import kd_tree, neighbours
    from cdff_common.geometry.robust import median_sigma

    _, rows = neighbours(kd_tree(points_m), points_m, 2)
    other = rows[:, 1]
    return median_sigma(np.einsum("ij,ij->i", points_m - points_m[other], normals[other]))
