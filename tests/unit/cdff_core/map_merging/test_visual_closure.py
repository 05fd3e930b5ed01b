# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Loop closures between the visual maps of two robots."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_core.map_merging.robot_maps import KeyframeId
from cdff_core.map_merging.visual_closure import VisualCloser
from tests.support import textured_walls as walls

PAIR = (KeyframeId("mana", 1_000_000_000), KeyframeId("minnie", 2_000_000_000))


def at(x_m: float, angle_rad: float) -> np.ndarray:
    return se3.transform(se3.exp_so3([0.0, angle_rad, 0.02]), [x_m, 0.02, 0.1 * x_m])


def test_two_keyframes_of_one_place_give_their_relative_pose_within_its_covariance() -> None:
    T_first, T_second = at(0.0, 0.0), at(0.3, -0.06)
    first, second = walls.wall_map([T_first, T_second]).keyframes
    closure = VisualCloser(MergingConfig(maps="visual")).compare(PAIR, first, second, 2)
    assert closure is not None
    assert closure.ends == PAIR
    error = pose_error(se3.inverse(T_first) @ T_second, closure.T.matrix)
    assert np.linalg.norm(error[:3]) < 0.03
    assert error @ np.linalg.solve(closure.T.covariance, error) < 30.0


def test_keyframes_of_different_places_are_refused_with_the_reason() -> None:
    (first,), (second,) = (
        walls.wall_map([at(0.0, 0.0)]).keyframes,
        walls.wall_map([at(0.0, 0.0)], seed=3).keyframes,
    )
    closer = VisualCloser(MergingConfig(maps="visual"))
    assert closer.compare(PAIR, first, second, 2) is None
    assert sum(closer.refusals.values()) == 1
    assert next(iter(closer.refusals)) in ("few_matches", "few_inliers", "few_points", "unconstrained")


def test_a_keyframe_with_a_wrong_scale_contradicts_the_other_direction() -> None:
    first, second = walls.wall_map([at(0.0, 0.0), at(0.4, -0.1)]).keyframes
    scaled = replace(second, positions_m=1.3 * second.positions_m, depth_sigmas_m=second.depth_sigmas_m)
    closer = VisualCloser(MergingConfig(maps="visual"))
    assert closer.compare(PAIR, first, scaled, 2) is None
    assert closer.refusals["contradictory"] == 1


@pytest.mark.parametrize(("yaw_deg", "is_comparable"), [(30.0, True), (90.0, False), (180.0, False)])
def test_keyframes_with_opposite_views_are_not_compared(yaw_deg: float, is_comparable: bool) -> None:
    T = se3.transform(se3.exp_so3([0.0, np.radians(yaw_deg), 0.0]), [0.0, 0.0, 0.0])
    assert VisualCloser(MergingConfig(maps="visual")).is_comparable(np.eye(4), T) is is_comparable
