# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Selection of the camera's pose if an object has more matches than the scene."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.dfns.perspective_n_point_solving.p3p_ransac import P3pRansac
from cdff_core.stereo_odometry.motion_hypotheses import MotionHypotheses
from cdff_core.visual_map.camera_pose import CameraPose, CameraPoseSolver
from cdff_core.visual_map.features import ImageFeatures
from cdff_core.visual_map.matches import MapMatches

SHAPE, FOCAL_PX, SIGMA_PX = (480, 640), 500.0, 0.5
SCENE, POINTS = 250, 600  # number of points of the scene, and of all points
T_MAP_CAMERA = se3.transform(np.eye(3), [0.0, 0.0, 0.5])


def solver() -> CameraPoseSolver:
    nodes = [P3pRansac(), P3pRansac()]
    for node in nodes:
        node.configure({})
    return CameraPoseSolver(nodes[0], SIGMA_PX, 4.2, MotionHypotheses(*nodes))


def solve(object_share: float, shape: tuple[int, int] | None = SHAPE) -> CameraPose:
    """Return the pose from matches all over the image; those in its left part move with the camera."""
    rng = np.random.default_rng(4)
    edge_px = object_share * SHAPE[1]
    scene_px = rng.uniform([edge_px, 0.0], [SHAPE[1], SHAPE[0]], (SCENE, 2))
    object_px = rng.uniform([0.0, 0.0], [edge_px, SHAPE[0]], (POINTS - SCENE, 2))
    centre = np.array([0.5 * SHAPE[1], 0.5 * SHAPE[0]])
    directions = (np.concatenate([scene_px, object_px]) - centre) / FOCAL_PX
    points_m = np.column_stack([directions, np.ones(POINTS)]) * rng.uniform(3.0, 12.0, POINTS)[:, None]
    moved_m = points_m.copy()
    moved_m[:SCENE] = se3.transform_points(se3.inverse(T_MAP_CAMERA), points_m[:SCENE])
    measured = moved_m[:, :2] / moved_m[:, 2:] + rng.normal(0.0, SIGMA_PX / FOCAL_PX, (POINTS, 2))
    features = ImageFeatures(measured * FOCAL_PX + centre, measured, np.zeros((POINTS, 0), np.uint8))
    rows, covariances = np.arange(POINTS), np.tile(1e-8 * np.eye(3), (POINTS, 1, 1))
    matches = MapMatches(points_m, covariances, rows, np.zeros(POINTS, np.int64), rows)
    return solver().solve(features, matches, FOCAL_PX, shape=shape)


def test_the_pose_of_the_scene_precedes_that_of_an_object_with_more_matches() -> None:
    pose = solve(0.22)
    T = pose.transform(1.0)
    np.testing.assert_allclose(T.matrix[:3, 3], T_MAP_CAMERA[:3, 3], atol=0.02)
    assert pose.ambiguity < 0.3
    assert pose.extent > 0.6
    np.testing.assert_array_equal(np.flatnonzero(pose.is_foreign) >= SCENE, True)
    assert pose.is_foreign.sum() > 0.9 * (POINTS - SCENE)


def test_an_object_over_half_of_the_image_makes_the_pose_ambiguous_and_less_certain() -> None:
    pose = solve(0.5)
    assert pose.ambiguity > 0.3
    distance_m = float(np.linalg.norm(T_MAP_CAMERA[:3, 3]))
    covariance = pose.transform(1.0).covariance
    assert covariance is not None
    probability = pose.ambiguity / (1.0 + pose.ambiguity)  # of the other pose
    assert np.sqrt(covariance[2, 2]) == pytest.approx(np.sqrt(probability) * distance_m, rel=0.1)


def test_without_the_size_of_the_image_the_pose_of_most_matches_is_taken() -> None:
    pose = solve(0.22, None)
    np.testing.assert_allclose(pose.transform(1.0).matrix[:3, 3], 0.0, atol=0.02)
    assert (pose.ambiguity, pose.extent) == (0.0, 1.0)
    assert not pose.is_foreign.any()
