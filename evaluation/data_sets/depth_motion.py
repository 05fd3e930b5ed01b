# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of a depth camera in a rigid scene, from its depth images alone.

The depth images of ``visp_rbt_rgbd`` are not taken at the same times as the colour images: while the camera
moves fast, the motion of the colour camera is wrong by centimetres for the depth image of the same number.
Open3D registers the whole scene of each depth image with that of the previous one.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray

#: Range of the points, voxel size, radius of the normals, and largest distances of pairs, metres.
_MAX_RANGE_M, _VOXEL_M, _NORMAL_RADIUS_M, _GATES_M = 1.5, 0.005, 0.015, (0.06, 0.03, 0.01)
_NORMAL_NEIGHBOURS, _ITERATIONS = 30, 60


def depth_motion(
    scenes_m: Mapping[int, FloatArray], poses: Mapping[int, FloatArray]
) -> dict[int, FloatArray]:
    """Return ``T_camera_start`` (4, 4) for each frame, in the order of the frames.

    Parameters
    ----------
    scenes_m : mapping of ndarray, shape (n, 3)
        Points of consecutive depth images in the frame of the camera, metres.
    poses : mapping of ndarray, shape (4, 4)
        ``T_camera_scene`` of the colour camera, from which the registrations start.
    """
    clouds = {frame: _cloud(points) for frame, points in scenes_m.items()}
    frames = sorted(scenes_m)
    motion = {frames[0]: np.eye(4)}
    for previous, frame in pairwise(frames):
        guess = poses[frame] @ se3.inverse(poses[previous])
        motion[frame] = _registered(clouds[previous], clouds[frame], guess) @ motion[previous]
    return motion


def _cloud(points_m: FloatArray) -> Any:
    import open3d as o3d

    near = points_m[points_m[:, 2] < _MAX_RANGE_M]
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(near)).voxel_down_sample(_VOXEL_M)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(_NORMAL_RADIUS_M, _NORMAL_NEIGHBOURS))
    return cloud


def _registered(source: Any, target: Any, T: FloatArray) -> FloatArray:
    """Return ``T_target_source`` by robust point-to-plane ICP, with decreasing gates."""
    from open3d.pipelines import registration

    for gate_m in _GATES_M:
        method = registration.TransformationEstimationPointToPlane(registration.TukeyLoss(0.5 * gate_m))
        criteria = registration.ICPConvergenceCriteria(max_iteration=_ITERATIONS)
        T = registration.registration_icp(source, target, gate_m, T, method, criteria).transformation
    return np.asarray(T, np.float64)
