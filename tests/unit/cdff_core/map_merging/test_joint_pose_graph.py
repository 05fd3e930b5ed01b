# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Loop closures between the maps of two robots correct the anchors of the maps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_core.map_merging.joint_pose_graph import MapMerger, closures_in_graph, fit_rigid_transform
from cdff_core.map_merging.robot_maps import KeyframeId
from tests.support.robot_maps import ROBOTS, T_SITE_SLAM, closure, error_m, maps


@pytest.mark.req("CDFF-SUP-190")
def test_one_closure_corrects_the_anchor_of_the_other_robot() -> None:
    merged = MapMerger(MergingConfig(), ROBOTS).merge(maps(), [closure(2, 3)])
    assert error_m(dict(merged.anchors)) < 0.02
    assert np.linalg.norm(merged.anchors["mana"].matrix - T_SITE_SLAM["mana"]) < 0.01
    assert max(merged.deformation_m.values()) < 0.02


def test_without_a_closure_each_map_keeps_its_surveyed_anchor() -> None:
    merged = MapMerger(MergingConfig(), ROBOTS).merge(maps(), [])
    for m in maps():
        np.testing.assert_allclose(merged.anchors[m.robot].matrix, m.survey.matrix, atol=1e-6)
        assert merged.anchors[m.robot].covariance[0, 0] == pytest.approx(m.survey.covariance[0, 0], rel=0.05)


def test_a_closure_makes_the_anchor_more_precise() -> None:
    surveyed, merged = (
        MapMerger(MergingConfig(), ROBOTS).merge(maps(), c).anchors for c in ([], [closure(1, 1)])
    )
    assert np.trace(merged["minnie"].covariance) < 0.01 * np.trace(surveyed["minnie"].covariance)


def test_a_wrong_closure_is_rejected_and_reported() -> None:
    wrong = closure(4, 1, se3.exp_se3([2.0, 1.0, 0.0, 0.0, 0.0, 0.5]))
    merged = MapMerger(MergingConfig(), ROBOTS).merge(
        maps(), [closure(0, 4), closure(2, 3), closure(3, 2), wrong]
    )
    assert merged.rejected == (wrong,)
    assert error_m(dict(merged.anchors)) < 0.02
    assert len(closures_in_graph(merged.graph, ROBOTS)) == 3


@pytest.mark.req("CDFF-SUP-192")
def test_closures_are_recovered_from_the_joint_graph() -> None:
    closures = [closure(0, 4), closure(2, 3)]
    result = closures_in_graph(MapMerger(MergingConfig(), ROBOTS).merge(maps(), closures).graph, ROBOTS)
    assert [c.ends for c in result] == [c.ends for c in closures]
    for recovered, original in zip(result, closures, strict=True):
        np.testing.assert_allclose(recovered.T.matrix, original.T.matrix, atol=1e-9)


def test_a_closure_of_a_removed_keyframe_is_ignored() -> None:
    of_removed_keyframe = replace(closure(0, 0), first=KeyframeId("mana", 7))
    merged = MapMerger(MergingConfig(), ROBOTS).merge(maps(), [of_removed_keyframe, closure(2, 3)])
    assert merged.rejected == ()
    assert error_m(dict(merged.anchors)) < 0.02


def test_the_rigid_transform_of_poses_on_a_line_is_recovered() -> None:
    T = se3.exp_se3([3.0, -2.0, 1.0, 0.1, 0.2, 2.0])
    in_child = np.array([se3.transform(np.eye(3), [i, 0.0, 0.0]) for i in range(4)])
    np.testing.assert_allclose(fit_rigid_transform(T @ in_child, in_child), T, atol=1e-12)
