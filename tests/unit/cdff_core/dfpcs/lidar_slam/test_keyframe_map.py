# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.codecs import decode, encode
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarMap
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE, ODOMETRY
from cdff_core.dfpcs.lidar_slam.keyframe_map import KeyFrame, KeyFrameMap

STEP_NS = 1_000_000_000


def uncertain(T: np.ndarray, sigma: float = 0.05) -> UncertainTransform:
    return UncertainTransform(T, sigma**2 * np.diag([1, 1, 1, 0.01, 0.01, 0.01]))


def square(rng: np.random.Generator, noise: float = 0.02) -> tuple[KeyFrameMap, list[np.ndarray]]:
    """Sixteen places around a square of 20 m, by odometry with noise; the true poses."""
    places, truth = KeyFrameMap(), [np.eye(4)]
    key = places.begin(0, np.eye(4))
    for i in range(15):
        turn = np.pi / 2 if i % 4 == 3 else 0.0
        step = se3.transform(se3.exp_so3([0, 0, turn]), [5.0, 0, 0])
        truth.append(truth[-1] @ step)
        measured = step @ se3.exp_se3(rng.normal(0, noise, 6) * [1, 1, 1, 0.1, 0.1, 0.1])
        key = places.follow(key, (i + 1) * STEP_NS, uncertain(measured))
    return places, truth


def optimiser() -> object:
    node = Registry.default().make_dfn("pose_graph_optimization", "ChordalGaussNewton")
    node.configure({"robust": "gnc"})
    return node


def errors(places: KeyFrameMap, truth: list[np.ndarray]) -> float:
    return float(np.sqrt(np.mean([np.sum((places.poses[k][:3, 3] - T[:3, 3]) ** 2) for k, T in enumerate(truth)])))


def test_a_loop_brings_the_places_nearer_to_where_they_are(rng: np.random.Generator) -> None:
    places, truth = square(rng)
    before = errors(places, truth)
    places.link(0, 15, uncertain(se3.inverse(truth[0]) @ truth[15], 0.005))
    assert places.optimise(optimiser()) == 0
    assert errors(places, truth) < 0.6 * before
    assert places.loops == 1


def test_a_loop_that_contradicts_the_others_goes(rng: np.random.Generator) -> None:
    places, truth = square(rng)
    for a, b in ((0, 15), (1, 14), (2, 13)):
        places.link(a, b, uncertain(se3.inverse(truth[a]) @ truth[b], 0.005))
    places.link(0, 8, uncertain(se3.transform(np.eye(3), [0.5, 0, 0]), 0.005))
    assert places.optimise(optimiser()) == 1
    assert places.loops_rejected == 1
    assert (0, 8, LOOP_CLOSURE) not in places.edges
    assert errors(places, truth) < 0.3


def test_a_place_goes_up_in_another_with_what_was_measured_to_it(rng: np.random.Generator) -> None:
    places, truth = square(rng, noise=0.0)
    near = se3.transform(se3.exp_so3([0, 0, 0.4]), [0.5, 0.2, 0.0])
    last = places.follow(15, 16 * STEP_NS, uncertain(se3.inverse(truth[15]) @ truth[2] @ near))
    places.dissolve(last, 2, uncertain(near))
    assert last not in places.frames
    edge = places.edges[2, 15, LOOP_CLOSURE]
    np.testing.assert_allclose(edge.T.matrix, se3.inverse(truth[2]) @ truth[15], atol=1e-9)


def test_between_two_places_the_better_known_loop_stays(rng: np.random.Generator) -> None:
    places, truth = square(rng)
    T = se3.inverse(truth[0]) @ truth[15]
    for sigma in (0.05, 0.01, 0.1):
        places.link(0, 15, uncertain(T, sigma))
    places.link(15, 0, uncertain(se3.inverse(T), 0.2))
    assert places.loops == 1
    assert places.edges[0, 15, LOOP_CLOSURE].T.covariance[0, 0] == pytest.approx(1e-4)


def test_a_part_that_a_loop_links_moves_to_where_the_loop_puts_it(rng: np.random.Generator) -> None:
    places, truth = square(rng, noise=0.0)
    first = places.begin(20 * STEP_NS, se3.exp_se3([100, 50, 3, 0.1, 0.2, 1.0]))
    second = places.follow(first, 21 * STEP_NS, uncertain(se3.transform(np.eye(3), [5.0, 0, 0])))
    assert places.part(places.root) == set(range(16))
    places.link(3, second, uncertain(np.eye(4), 0.01))
    assert places.part(places.root) == {*range(16), first, second}
    np.testing.assert_allclose(places.poses[second], truth[3], atol=1e-9)
    np.testing.assert_allclose(places.poses[first][:3, 3], (truth[3] @ [-5.0, 0, 0, 1])[:3], atol=1e-9)


def test_ways_are_the_shortest_along_edges(rng: np.random.Generator) -> None:
    places, truth = square(rng, noise=0.0)
    assert places.ways_m(0)[15] == pytest.approx(75.0)
    places.link(0, 15, uncertain(se3.inverse(truth[0]) @ truth[15]))
    assert places.ways_m(0)[15] == pytest.approx(float(np.linalg.norm(truth[15][:3, 3])))


def test_a_map_comes_back_from_its_message_as_it_was(rng: np.random.Generator) -> None:
    places, truth = square(rng)
    for key, frame in places.frames.items():
        points = rng.normal(0, 5, (10 + key, 3)).astype(np.float32)
        places.frames[key] = KeyFrame(frame.stamp_ns, points)
    places.link(0, 15, uncertain(se3.inverse(truth[0]) @ truth[15], 0.01))
    message = places.to_message(frame="mana/slam", sensor="mana/lidar", producer="test", position=(3, np.eye(4)))
    message = decode("LidarMap", encode(message, "uper"), "uper")
    assert isinstance(message, LidarMap)
    assert message.last_position[0] == 3
    assert len(message.points_m) == sum(10 + k for k in range(16))
    again = KeyFrameMap()
    new = again.absorb(message)
    assert again.root == new[0]
    assert set(again.edges) == {(new[a], new[b], kind) for a, b, kind in places.edges}
    for key in places.frames:
        np.testing.assert_allclose(again.poses[new[key]], places.poses[key], atol=1e-12)
        np.testing.assert_array_equal(again.frames[new[key]].points_m, places.frames[key].points_m)
    edge = again.edges[new[0], new[1], ODOMETRY].T
    np.testing.assert_allclose(edge.covariance, places.edges[0, 1, ODOMETRY].T.covariance, rtol=1e-3, atol=1e-7)


def test_a_second_map_is_held_beside_the_first(rng: np.random.Generator) -> None:
    places, _ = square(rng)
    other, _ = square(rng)
    message = other.to_message(frame="minnie/slam", sensor="minnie/lidar", producer="test", position=None)
    new = places.absorb(message)
    assert len(places) == 32
    assert places.root == 0
    assert places.part(0).isdisjoint(new.values())


def test_loops_of_a_place_are_taken_away_and_its_odometry_stays(rng: np.random.Generator) -> None:
    places, truth = square(rng)
    places.link(0, 15, uncertain(se3.inverse(truth[0]) @ truth[15]))
    places.link(1, 14, uncertain(se3.inverse(truth[1]) @ truth[14]))
    places.unlink(15)
    assert {e for e in places.edges if e[2] == LOOP_CLOSURE} == {(1, 14, LOOP_CLOSURE)}
    assert (14, 15, ODOMETRY) in places.edges
