# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What both registrations need of a cloud's surface: even density, spacing and normals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry.voxels import voxel_for, voxel_means

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]
_SAMPLE = 5000


def evened(source: FloatArray, target: FloatArray, wanted: int | None) -> tuple[FloatArray, FloatArray]:
    """Both clouds thinned with the voxels that leave about ``wanted`` points of the bigger one; None leaves them."""
    if wanted is None:
        return source, target
    voxel_m = max(voxel_for(source, wanted), voxel_for(target, wanted))
    if voxel_m == 0.0:
        return source, target
    return voxel_means(source, voxel_m), voxel_means(target, voxel_m)


def spacing_m(tree: cKDTree) -> float:
    """Median distance of a point to its nearest neighbour, from at most 5000 points spread over the cloud."""
    points = tree.data[:: max(1, tree.n // _SAMPLE)]
    distance_m, _ = tree.query(points, k=2)
    return max(float(np.median(distance_m[:, 1])), 1e-9)


def estimated_normals(points: FloatArray, tree: cKDTree, neighbours: int, given: FloatArray | None) -> FloatArray:
    """Unit normals (n, 3): those given once checked, else the axes of least variance of each neighbourhood."""
    if given is not None:
        normals = np.asarray(given, dtype=np.float64)
        if normals.shape != points.shape or not np.all(np.isfinite(normals)):
            raise InputError(f"target_normals: shape {normals.shape}, expected finite values of shape {points.shape}")
        return normals
    _, neighbour = tree.query(points, k=neighbours)
    offset = points[neighbour]
    offset -= offset.mean(axis=1, keepdims=True)
    _, axis = np.linalg.eigh(np.einsum("nki,nkj->nij", offset, offset))
    return np.ascontiguousarray(axis[:, :, 0])
