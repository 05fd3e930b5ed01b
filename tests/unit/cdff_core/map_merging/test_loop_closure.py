# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Selection and registration of pairs of keyframes of two robots."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_common.types import Pointcloud, PoseGraph
from cdff_core.map_merging.loop_closure import LidarCloser
from cdff_core.map_merging.robot_maps import Closure, KeyframeId, RobotMap

T_FIRST_SECOND = se3.exp_se3([1.5, -0.7, 0.1, 0.01, 0.02, 0.6])


def robot_map(robot: str, x_m: list[float], sigma_m: float = 0.0) -> RobotMap:
    poses = np.array([se3.transform(np.eye(3), [x, 0.0, 0.0]) for x in x_m])
    n = len(x_m)
    graph = PoseGraph.from_arrays(
        np.arange(n),
        (np.arange(n) + 1) * 1000,
        poses,
        np.zeros((0, 2)),
        np.zeros((0, 4, 4)),
        np.zeros((0, 6, 6)),
        [],
        frame=f"{robot}/slam",
    )
    anchor = UncertainTransform(np.eye(4), np.diag([sigma_m**2] * 3 + [1e-6] * 3))
    return RobotMap(robot, graph, anchor, anchor)


def ground(rng: np.random.Generator, T: FloatArray) -> Pointcloud:
    """Return points of the same hilly ground with boulders, in the frame of a lidar at pose ``T``."""
    terrain_rng = np.random.default_rng(3)
    xy = rng.uniform(-14.0, 14.0, (25_000, 2))
    z = np.zeros(len(xy))
    for _ in range(60):
        centre, width = terrain_rng.uniform(-14.0, 14.0, 2), terrain_rng.uniform(0.4, 2.5)
        z += terrain_rng.uniform(-0.5, 0.7) * np.exp(-np.sum((xy - centre) ** 2, axis=1) / width**2)
    points = np.column_stack([xy, z + rng.normal(0.0, 0.01, len(z))])
    return Pointcloud.from_points(
        se3.transform_points(se3.inverse(T), points), frame="mana/keyframe", stamp_ns=1000
    )


def test_pairs_are_ordered_by_distance_within_the_radius() -> None:
    closer = LidarCloser(MergingConfig(search_radius_m=6.0))
    pairs = closer.pairs([robot_map("minnie", [4.0, 20.0]), robot_map("mana", [0.0, 5.0, 50.0])], [])
    assert pairs == [
        (KeyframeId("mana", 2000), KeyframeId("minnie", 1000)),
        (KeyframeId("mana", 1000), KeyframeId("minnie", 1000)),
    ]


def test_an_imprecise_anchor_widens_the_search() -> None:
    closer = LidarCloser(MergingConfig(search_radius_m=6.0))
    assert not closer.pairs([robot_map("mana", [0.0]), robot_map("minnie", [8.0])], [])
    assert closer.pairs([robot_map("mana", [0.0]), robot_map("minnie", [8.0], sigma_m=3.0)], [])


def test_keyframes_with_a_closure_are_not_compared_again() -> None:
    maps = [robot_map("mana", [0.0]), robot_map("minnie", [1.0])]
    closure = Closure(
        KeyframeId("mana", 1000), KeyframeId("minnie", 1000), UncertainTransform(np.eye(4), np.eye(6))
    )
    assert not LidarCloser(MergingConfig()).pairs(maps, [closure])


@pytest.mark.req("CDFF-SUP-191")
def test_clouds_of_the_same_terrain_are_registered_without_a_guess(rng: np.random.Generator) -> None:
    closer = LidarCloser(MergingConfig())
    pair = (KeyframeId("mana", 1000), KeyframeId("minnie", 1000))
    loop = closer.compare(pair, ground(rng, np.eye(4)), ground(rng, T_FIRST_SECOND), 2)
    assert loop is not None
    assert np.linalg.norm((loop.T.matrix - T_FIRST_SECOND)[:3, 3]) < 0.05


def test_a_refused_pair_is_compared_again_only_when_the_maps_have_grown(
    rng: np.random.Generator,
) -> None:
    closer = LidarCloser(MergingConfig(search_radius_m=100.0))
    maps = [robot_map("mana", [0.0]), robot_map("minnie", [1.0])]
    (pair,) = closer.pairs(maps, [])
    noise = Pointcloud.from_points(
        rng.uniform(-10.0, 10.0, (5000, 3)), frame="minnie/keyframe", stamp_ns=1000
    )
    assert closer.compare(pair, ground(rng, np.eye(4)), noise, 2) is None
    assert sum(closer.refusals.values()) == 1
    assert not closer.pairs(maps, [])
    assert pair in closer.pairs([robot_map("mana", [0.0, 5.0]), robot_map("minnie", [1.0, 5.0])], [])
