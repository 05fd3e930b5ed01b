# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Directions of the pose that the local map constrains."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.dfns.scan_to_map_registration import _kernels, _voxel_table
from cdff_core.dfns.scan_to_map_registration._optimisation import Estimate
from cdff_core.dfns.scan_to_map_registration._voxel_map import VoxelMap


def observability(
    local_map: VoxelMap,
    points: FloatArray,
    point_times: FloatArray,
    pose_estimate: Estimate,
    kernel_m: float,
    min_plane_points: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the directions of the information, the agreement of both halves of the map along them, and the
    standard deviations along them.

    One point per voxel is used, since points on the same plane share its noise, and only planes of enough
    points: the normals of planes through a few distant points of a new map are noisy, and their long lever
    arm would hide the information of the near ground on rotations.
    """
    sampled_rows = _voxel_table.first_in_voxels(points, local_map.voxel_m)
    points, point_times = points[sampled_rows], point_times[sampled_rows]
    R = se3.exp_so3(point_times[:, None] * pose_estimate.motion[None, 3:])
    deskewed = np.einsum("nij,nj->ni", R, points) + point_times[:, None] * pose_estimate.motion[:3]
    H, cross_information, total_weight = _kernels.common_information(
        local_map.tables,
        local_map.voxel_m,
        deskewed,
        np.ascontiguousarray(pose_estimate.T[:3, :3]),
        pose_estimate.T[:3, 3].copy(),
        kernel_m,
        pose_estimate.noise_m,
        pose_estimate.radius_m,
        min_plane_points,
    )
    values, vectors = np.linalg.eigh(H)
    common = np.einsum("ij,ik,kj->j", vectors, cross_information, vectors)
    agreement = common / np.maximum(values, 1e-12)
    sigma_m = np.sqrt(pose_estimate.variance / np.maximum(common * total_weight, 1e-12))
    return np.ascontiguousarray(vectors.T, np.float64), agreement, sigma_m
