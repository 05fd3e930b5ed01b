# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps of several robots are put where they belong by the closures between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.merging import MergingConfig
from cdff_common.types import PoseGraph
from cdff_core.map_merging.places import Closure, Place, RobotMap
from cdff_core.map_merging.solving import MapMerger, closures_of, rigid_fit

ROBOTS = ("mana", "minnie")
STEP = se3.exp_se3([5.0, 0.3, 0.1, 0.01, 0.02, 0.2])
EXACT = np.diag([0.005**2] * 3 + [0.0005**2] * 3)
TRUE = {"mana": np.eye(4), "minnie": se3.transform(se3.exp_so3([0.02, -0.01, 2.9]), [18.0, 4.0, 0.5])}


def chain(robot: str, off: FloatArray, sigma_m: float, places: int = 5) -> RobotMap:
    """A robot's map of a way of some places, its survey ``off`` from the truth."""
    poses = [np.eye(4)]
    for _ in range(places - 1):
        poses.append(poses[-1] @ STEP)
    graph = PoseGraph.from_arrays(
        np.arange(places) + 3, (np.arange(places) + 1) * 10**10, np.array(poses),
        np.array([[i + 3, i + 4] for i in range(places - 1)]), np.array([STEP] * (places - 1)),
        np.array([np.linalg.inv(EXACT)] * (places - 1)), [0] * (places - 1), frame=f"{robot}/slam",
        fixed=np.arange(places) == 0,
    )  # fmt: skip
    survey = UncertainTransform(
        TRUE[robot] @ off, np.diag([sigma_m**2] * 3 + [0.1**2] * 3 if sigma_m > 0.1 else [1e-6] * 6)
    )
    return RobotMap(robot, graph, survey, survey)


def maps() -> list[RobotMap]:
    return [chain("mana", np.eye(4), 0.01), chain("minnie", se3.exp_se3([1.0, -0.8, 0.2, 0.0, 0.0, 0.08]), 1.5)]


def closure(a: int, b: int, wrong: FloatArray | None = None) -> Closure:
    one, other = (list(m.places.items())[i] for m, i in zip(maps(), (a, b), strict=True))
    T = se3.inverse(TRUE["mana"] @ one[1]) @ TRUE["minnie"] @ other[1]
    return Closure(one[0], other[0], UncertainTransform(T if wrong is None else wrong @ T, EXACT))


def off_m(anchors: dict[str, UncertainTransform]) -> float:
    relative = se3.inverse(anchors["mana"].matrix) @ anchors["minnie"].matrix
    return float(np.linalg.norm((relative - se3.inverse(TRUE["mana"]) @ TRUE["minnie"])[:3, 3]))


@pytest.mark.req("CDFF-SUP-190")
def test_one_closure_puts_the_map_of_the_other_robot_where_it_belongs() -> None:
    merged = MapMerger(MergingConfig(), ROBOTS).merged(maps(), [closure(2, 3)])
    assert off_m(dict(merged.anchors)) < 0.02
    assert np.linalg.norm(merged.anchors["mana"].matrix - TRUE["mana"]) < 0.01
    assert max(merged.bent_m.values()) < 0.02


def test_without_a_closure_each_map_stays_where_it_was_surveyed() -> None:
    merged = MapMerger(MergingConfig(), ROBOTS).merged(maps(), [])
    for m in maps():
        np.testing.assert_allclose(merged.anchors[m.robot].matrix, m.surveyed.matrix, atol=1e-6)
        assert merged.anchors[m.robot].covariance[0, 0] == pytest.approx(m.surveyed.covariance[0, 0], rel=0.05)


def test_a_closure_makes_the_anchor_better_known() -> None:
    before, after = (MapMerger(MergingConfig(), ROBOTS).merged(maps(), c).anchors for c in ([], [closure(1, 1)]))
    assert np.trace(after["minnie"].covariance) < 0.01 * np.trace(before["minnie"].covariance)


def test_a_wrong_closure_among_right_ones_is_left_out_and_named() -> None:
    wrong = closure(4, 1, se3.exp_se3([2.0, 1.0, 0.0, 0.0, 0.0, 0.5]))
    merged = MapMerger(MergingConfig(), ROBOTS).merged(maps(), [closure(0, 4), closure(2, 3), closure(3, 2), wrong])
    assert merged.rejected == (wrong,)
    assert off_m(dict(merged.anchors)) < 0.02
    assert len(closures_of(merged.graph, ROBOTS)) == 3


@pytest.mark.req("CDFF-SUP-192")
def test_closures_are_read_back_from_the_merged_graph_whatever_the_ids_of_key_frames() -> None:
    given = [closure(0, 4), closure(2, 3)]
    found = closures_of(MapMerger(MergingConfig(), ROBOTS).merged(maps(), given).graph, ROBOTS)
    assert [c.ends for c in found] == [c.ends for c in given]
    for one, other in zip(found, given, strict=True):
        np.testing.assert_allclose(one.T.matrix, other.T.matrix, atol=1e-9)


def test_a_closure_with_a_place_that_is_gone_counts_no_more() -> None:
    gone = replace(closure(0, 0), first=Place("mana", 7))
    merged = MapMerger(MergingConfig(), ROBOTS).merged(maps(), [gone, closure(2, 3)])
    assert merged.rejected == ()
    assert off_m(dict(merged.anchors)) < 0.02


def test_a_rigid_fit_finds_the_transform_of_poses_on_a_line() -> None:
    T = se3.exp_se3([3.0, -2.0, 1.0, 0.1, 0.2, 2.0])
    inside = np.array([se3.transform(np.eye(3), [i, 0.0, 0.0]) for i in range(4)])
    np.testing.assert_allclose(rigid_fit(T @ inside, inside), T, atol=1e-12)
