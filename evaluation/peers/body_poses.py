# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses of a known body in a cloud by FPFH with RANSAC, ICP from many rotations, and KISS-Matcher.

All functions take the points of the model (m, 3) and those of the scene (n, 3), metres, and return
``T_scene_model`` (4, 4) and the CPU time, seconds. The first two always answer.
"""

from __future__ import annotations

import time

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.geometry.voxels import voxel_means
from evaluation.peers.environments import PEER_VOXEL_M, kiss_matcher

#: Edge of the voxels of FPFH and KISS-Matcher, in diameters of the model.
_VOXEL_DIAMETERS = 0.05
#: Distances of correspondences of the two runs of ICP, in diameters of the model, and their steps.
_ICP_DIAMETERS, _ICP_STEPS = (0.25, 0.06), 30


def diameter_of(points_m: FloatArray) -> float:
    """Return twice the largest distance from the mean of points (n, 3)."""
    return 2.0 * float(np.max(np.linalg.norm(points_m - points_m.mean(axis=0), axis=1)))


def fpfh_ransac(model_m: FloatArray, scene_m: FloatArray) -> tuple[FloatArray, float]:
    """Return the pose by Open3D's FPFH, RANSAC and ICP, as in its documentation."""
    import open3d as o3d

    voxel_m = _VOXEL_DIAMETERS * diameter_of(model_m)
    started = time.process_time()
    clouds, features = [], []
    o3d.utility.random.seed(0)
    for points in (model_m, scene_m):
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)).voxel_down_sample(voxel_m)
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(2.0 * voxel_m, 30))
        clouds.append(cloud)
        features.append(
            o3d.pipelines.registration.compute_fpfh_feature(
                cloud, o3d.geometry.KDTreeSearchParamHybrid(5.0 * voxel_m, 100)
            )
        )
    registration = o3d.pipelines.registration
    coarse = registration.registration_ransac_based_on_feature_matching(
        *clouds,
        *features,
        True,
        1.5 * voxel_m,
        registration.TransformationEstimationPointToPoint(False),
        3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(1.5 * voxel_m),
        ],
        registration.RANSACConvergenceCriteria(100_000, 0.999),
    )
    fine = registration.registration_icp(
        *clouds,
        0.4 * voxel_m,
        coarse.transformation,
        registration.TransformationEstimationPointToPlane(),
    )
    return np.asarray(fine.transformation), time.process_time() - started


def icp_of_rotations(
    model_m: FloatArray, scene_m: FloatArray, rotations: int = 60
) -> tuple[FloatArray, float]:
    """Return the pose by Open3D's ICP from rotations on all sides, with equal centroids at the start.

    The pose with the most correspondences, and of equal ones that with the smallest residuals, is continued
    with a smaller distance of the correspondences.
    """
    import open3d as o3d
    from scipy.spatial.transform import Rotation

    registration = o3d.pipelines.registration
    diameter_m = diameter_of(model_m)
    started = time.process_time()
    model, scene = (o3d.geometry.PointCloud(o3d.utility.Vector3dVector(p)) for p in (model_m, scene_m))
    best = None
    for R in Rotation.random(rotations, random_state=0).as_matrix():
        start = se3.transform(R, model_m.mean(axis=0) - R @ scene_m.mean(axis=0))
        result = registration.registration_icp(
            scene,
            model,
            _ICP_DIAMETERS[0] * diameter_m,
            start,
            registration.TransformationEstimationPointToPoint(),
            registration.ICPConvergenceCriteria(max_iteration=_ICP_STEPS),
        )
        if best is None or (-result.fitness, result.inlier_rmse) < (-best.fitness, best.inlier_rmse):
            best = result
    assert best is not None
    fine = registration.registration_icp(
        scene,
        model,
        _ICP_DIAMETERS[1] * diameter_m,
        best.transformation,
        registration.TransformationEstimationPointToPoint(),
        registration.ICPConvergenceCriteria(max_iteration=_ICP_STEPS),
    )
    return se3.inverse(np.asarray(fine.transformation)), time.process_time() - started


def kiss_matcher_pose(
    python: str, model_m: FloatArray, scene_m: FloatArray
) -> tuple[FloatArray | None, float]:
    """Return the pose of KISS-Matcher, None if it states that it is invalid.

    The clouds are scaled so that its voxels fit the model.
    """
    voxel_m = _VOXEL_DIAMETERS * diameter_of(model_m)
    scale = PEER_VOXEL_M / voxel_m
    model, scene = (scale * voxel_means(points, 0.5 * voxel_m) for points in (model_m, scene_m))
    ((T, cpu_s),) = kiss_matcher(python, [(model, scene)])
    if T is not None:
        T = T.copy()
        T[:3, 3] /= scale
    return T, cpu_s
