# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measured pairs of point clouds with their true transforms."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.formats.pcd import read_pcd
from cdff_common.formats.ply import read_ply
from cdff_common.formats.pose import read_pose
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray

#: Source points, target points and ``T_target_source``.
Pair = tuple[FloatArray, FloatArray, FloatArray]

#: ``T_camera_lidar`` of KITTI sequence 00 (left camera, velodyne), from its calibration.
T_CAMERA_LIDAR = np.array(
    [
        [4.276802385584e-04, -9.999672484946e-01, -8.084491683471e-03, -1.198459927713e-02],
        [-7.210626507497e-03, 8.081198471645e-03, -9.999413164504e-01, -5.403984729748e-02],
        [9.999738645903e-01, 4.859485810390e-04, -7.206933692422e-03, -2.921968648686e-01],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
#: Unrefined ``T_scene_model`` that PCL's correspondence grouping tutorial prints for its only instance of the
#: milk carton. The scene of the tutorial has y down and z forwards, the file y up and z backwards; the pose
#: is therefore rotated by 180 degrees about x.
PCL_MILK = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.array(
    [
        [0.968, -0.148, 0.201, -0.171],
        [-0.146, -0.989, -0.023, -0.204],
        [0.202, -0.007, -0.979, 0.043],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


def kitti_pair(data: Path) -> Pair:
    """Return scans 95 and 94 of sequence 00, and T_94_95."""
    folder = data / "kitti_velodyne"
    poses = np.loadtxt(folder / "00_poses_cam0.txt").reshape(-1, 3, 4)
    T_camera0_94, T_camera0_95 = (np.vstack([poses[i], [0, 0, 0, 1]]) for i in (94, 95))
    T_94_95 = se3.inverse(T_CAMERA_LIDAR) @ se3.inverse(T_camera0_94) @ T_camera0_95 @ T_CAMERA_LIDAR
    target, source = (read_kitti_bin(folder / f"{i:06d}.bin").points_m for i in (94, 95))
    return source, target, T_94_95


def small_gicp_pair(data: Path) -> Pair:
    """Return source, target and the approximate T_target_source of small_gicp's example."""
    folder = data / "small_gicp_pair"
    source, target = (read_ply(folder / f"{name}.ply").points_m for name in ("source", "target"))
    return source, target, read_pose(folder / "T_target_source.txt").T.matrix


def devon_island(data: Path) -> Pair:
    """Return Devon Island's road, its transformed copy with 0.5 mm noise in the same point order, and
    T_copy_road.
    """
    folder = data / "cdff_upstream" / "PointClouds"
    road, copy = (
        read_ply(folder / f"DevonIslandRoad1{name}.ply").points_m for name in ("", "TransformedNoise")
    )
    numbers = np.loadtxt(folder / "CloudsTransform.txt").ravel()
    R = se3.matrix_from_quaternion_xyzw(numbers[3:])
    return road, copy, se3.transform(R, R @ numbers[:3])


def devon_halves(data: Path, seed: int = 0) -> Pair:
    """Return one half of the points of the road, the other half of the points of its copy, and T_copy_road.

    No point of the road has its own copy in the second cloud.
    """
    road, copy, T = devon_island(data)
    indices, half = np.random.default_rng(seed).permutation(len(road)), len(road) // 2
    return road[indices[:half]], copy[indices[half:]], T


def milk_carton(data: Path) -> Pair:
    """Return model and scene of PCL's tutorial, and the pose that it prints."""
    folder = data / "pcl_recognition" / "correspondence_grouping"
    model, scene = (read_pcd(folder / n).points_m for n in ("milk.pcd", "milk_cartoon_all_small_clorox.pcd"))
    return model[np.isfinite(model).all(axis=1)], scene[np.isfinite(scene).all(axis=1)], PCL_MILK
