# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Selection among rigid motions of points by coverage of the image, wheels, gyro and known velocity."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.dfns.perspective_n_point_solving.interface import PerspectiveNPointSolvingInputs
from cdff_core.dfns.perspective_n_point_solving.p3p_ransac import P3pRansac
from cdff_core.stereo_odometry.motion_hypotheses import MotionHypotheses, SelectedMotion
from cdff_core.stereo_odometry.motion_prior import MotionBounds
from tests.support.corridor import CAMERA, SHAPE

FORWARD = se3.transform(np.eye(3), [0.0, 0.0, -0.5])  # T_current_keyframe
REST = np.eye(4)
SCENE, POINTS = 250, 600  # number of points of the scene, and of all points


def motions() -> MotionHypotheses:
    nodes = (P3pRansac(), P3pRansac())
    for node in nodes:
        node.configure({})
    return MotionHypotheses(*nodes)


def inputs(object_share: float, guess: np.ndarray = REST) -> PerspectiveNPointSolvingInputs:
    """Return points all over the image; those in its left part are denser and move with the camera."""
    rng = np.random.default_rng(4)
    edge_px = object_share * SHAPE[1]
    scene_px = rng.uniform([edge_px, 0.0], [SHAPE[1], SHAPE[0]], (SCENE, 2))
    object_px = rng.uniform([0.0, 0.0], [edge_px, SHAPE[0]], (POINTS - SCENE, 2))
    pixels, depths_m = np.concatenate([scene_px, object_px]), rng.uniform(3.0, 12.0, POINTS)
    rays = np.column_stack([(pixels - CAMERA[:2, 2]) / CAMERA[0, 0], np.ones(POINTS)])
    points = rays * depths_m[:, None]
    moved_points = np.where(np.arange(POINTS)[:, None] < SCENE, se3.transform_points(FORWARD, points), points)
    projected = (moved_points / moved_points[:, 2:]) @ CAMERA.T
    projections = projected[:, :2] + rng.normal(0.0, 0.3, (POINTS, 2))
    return PerspectiveNPointSolvingInputs(
        points=points, projections=projections, camera_matrix=CAMERA, guess=guess
    )


def is_forward(motion: SelectedMotion) -> bool:
    return float(np.linalg.norm(motion.scene.pose[:3, 3] - FORWARD[:3, 3])) < 0.1


def test_the_motion_that_covers_the_image_precedes_that_with_more_points() -> None:
    motion = motions().select(inputs(0.22), SHAPE, None, is_continued=False)
    assert is_forward(motion)
    assert motion.other_inliers.sum() > motion.scene.inliers.sum()
    assert not motion.is_ambiguous
    assert not motion.selection_covariance().any()


@pytest.mark.parametrize(("guess", "expected"), [(FORWARD, True), (REST, False)])
def test_motions_of_similar_coverage_are_reported_and_the_nearest_to_the_velocity_is_selected(
    guess: np.ndarray, expected: bool
) -> None:
    motion = motions().select(inputs(0.5, guess), SHAPE, None, is_continued=True)
    assert motion.is_ambiguous
    assert is_forward(motion) == expected
    sigma_m = np.sqrt(motion.selection_covariance()[2, 2])
    assert 0.5 * 0.5 < sigma_m < 0.5 * 1.0  # about half of the 0.5 m between both motions


def test_wheels_exclude_a_motion() -> None:
    bounds = MotionBounds(se3.inverse(FORWARD), sigma_m=0.1, sigma_rad=np.inf)
    motion = motions().select(inputs(0.6, FORWARD), SHAPE, bounds, is_continued=False)
    assert is_forward(motion)
    assert motion.prior_ratio < 0.3
    assert not motion.is_ambiguous


def test_wheels_that_contradict_all_motions_are_reported_and_ignored() -> None:
    spinning = se3.transform(np.eye(3), [0.0, 0.0, -3.0])
    bounds = MotionBounds(se3.inverse(spinning), sigma_m=0.1, sigma_rad=np.inf)
    motion = motions().select(inputs(0.22, spinning), SHAPE, bounds, is_continued=False)
    assert is_forward(motion)
    assert motion.prior_ratio > 1.0
