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
from cdff_core.dfpcs.lidar_slam.keyframe_map import Keyframe, KeyframeMap

STEP_NS = 1_000_000_000


def uncertain(T: np.ndarray, sigma: float = 0.05) -> UncertainTransform:
    return UncertainTransform(T, sigma**2 * np.diag([1, 1, 1, 0.01, 0.01, 0.01]))


def square(rng: np.random.Generator, noise: float = 0.02) -> tuple[KeyframeMap, list[np.ndarray]]:
    """Return sixteen keyframes around a square of 20 m from noisy odometry, and their true poses."""
    keyframes, true_poses = KeyframeMap(), [np.eye(4)]
    key = keyframes.start_component(0, np.eye(4))
    for i in range(15):
        angle_rad = np.pi / 2 if i % 4 == 3 else 0.0
        step = se3.transform(se3.exp_so3([0, 0, angle_rad]), [5.0, 0, 0])
        true_poses.append(true_poses[-1] @ step)
        noisy_step = step @ se3.exp_se3(rng.normal(0, noise, 6) * [1, 1, 1, 0.1, 0.1, 0.1])
        key = keyframes.add_successor(key, (i + 1) * STEP_NS, uncertain(noisy_step))
    return keyframes, true_poses


def optimiser() -> object:
    node = Registry.default().make_dfn("pose_graph_optimization", "ChordalGaussNewton")
    node.configure({"robust": "gnc"})
    return node


def rms_error_m(keyframes: KeyframeMap, true_poses: list[np.ndarray]) -> float:
    errors = np.array([keyframes.poses[k][:3, 3] - T[:3, 3] for k, T in enumerate(true_poses)])
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


def test_a_loop_reduces_the_errors_of_the_keyframes(rng: np.random.Generator) -> None:
    keyframes, true_poses = square(rng)
    error_by_odometry_m = rms_error_m(keyframes, true_poses)
    keyframes.add_loop(0, 15, uncertain(se3.inverse(true_poses[0]) @ true_poses[15], 0.005))
    assert keyframes.optimise(optimiser()) == 0
    assert rms_error_m(keyframes, true_poses) < 0.6 * error_by_odometry_m
    assert keyframes.loop_count == 1


def test_a_loop_that_contradicts_the_others_is_removed(rng: np.random.Generator) -> None:
    keyframes, true_poses = square(rng)
    for a, b in ((0, 15), (1, 14), (2, 13)):
        keyframes.add_loop(a, b, uncertain(se3.inverse(true_poses[a]) @ true_poses[b], 0.005))
    keyframes.add_loop(0, 8, uncertain(se3.transform(np.eye(3), [0.5, 0, 0]), 0.005))
    assert keyframes.optimise(optimiser()) == 1
    assert keyframes.loops_rejected == 1
    assert (0, 8, LOOP_CLOSURE) not in keyframes.edges
    assert rms_error_m(keyframes, true_poses) < 0.3


def test_the_edges_of_a_replaced_keyframe_move_to_the_older_one(rng: np.random.Generator) -> None:
    keyframes, true_poses = square(rng, noise=0.0)
    near = se3.transform(se3.exp_so3([0, 0, 0.4]), [0.5, 0.2, 0.0])
    last = keyframes.add_successor(
        15, 16 * STEP_NS, uncertain(se3.inverse(true_poses[15]) @ true_poses[2] @ near)
    )
    keyframes.replace_by(last, 2, uncertain(near))
    assert last not in keyframes.keyframes
    edge = keyframes.edges[2, 15, LOOP_CLOSURE]
    np.testing.assert_allclose(edge.matrix, se3.inverse(true_poses[2]) @ true_poses[15], atol=1e-9)


def test_of_two_loops_between_keyframes_the_more_precise_one_is_kept(rng: np.random.Generator) -> None:
    keyframes, true_poses = square(rng)
    T = se3.inverse(true_poses[0]) @ true_poses[15]
    for sigma in (0.05, 0.01, 0.1):
        keyframes.add_loop(0, 15, uncertain(T, sigma))
    keyframes.add_loop(15, 0, uncertain(se3.inverse(T), 0.2))
    assert keyframes.loop_count == 1
    assert keyframes.edges[0, 15, LOOP_CLOSURE].covariance[0, 0] == pytest.approx(1e-4)


def test_a_component_connected_by_a_loop_is_moved_to_satisfy_the_loop(rng: np.random.Generator) -> None:
    keyframes, true_poses = square(rng, noise=0.0)
    first = keyframes.start_component(20 * STEP_NS, se3.exp_se3([100, 50, 3, 0.1, 0.2, 1.0]))
    second = keyframes.add_successor(first, 21 * STEP_NS, uncertain(se3.transform(np.eye(3), [5.0, 0, 0])))
    assert keyframes.component(keyframes.root) == set(range(16))
    keyframes.add_loop(3, second, uncertain(np.eye(4), 0.01))
    assert keyframes.component(keyframes.root) == {*range(16), first, second}
    np.testing.assert_allclose(keyframes.poses[second], true_poses[3], atol=1e-9)
    np.testing.assert_allclose(
        keyframes.poses[first][:3, 3], (true_poses[3] @ [-5.0, 0, 0, 1])[:3], atol=1e-9
    )


def test_path_lengths_are_those_of_the_shortest_path_along_edges(rng: np.random.Generator) -> None:
    keyframes, true_poses = square(rng, noise=0.0)
    assert keyframes.path_lengths_m(0)[15] == pytest.approx(75.0)
    keyframes.add_loop(0, 15, uncertain(se3.inverse(true_poses[0]) @ true_poses[15]))
    assert keyframes.path_lengths_m(0)[15] == pytest.approx(float(np.linalg.norm(true_poses[15][:3, 3])))


def test_a_map_is_unchanged_by_encoding_and_decoding(rng: np.random.Generator) -> None:
    keyframes, true_poses = square(rng)
    for key, frame in keyframes.keyframes.items():
        points = rng.normal(0, 5, (10 + key, 3)).astype(np.float32)
        keyframes.keyframes[key] = Keyframe(frame.stamp_ns, points)
    keyframes.add_loop(0, 15, uncertain(se3.inverse(true_poses[0]) @ true_poses[15], 0.01))
    message = keyframes.to_message(
        frame="mana/slam", sensor="mana/lidar", producer="test", position=(3, np.eye(4))
    )
    message = decode("LidarMap", encode(message, "uper"), "uper")
    assert isinstance(message, LidarMap)
    assert message.last_position[0] == 3
    assert len(message.points_m) == sum(10 + k for k in range(16))
    reread = KeyframeMap()
    new_ids = reread.add_message(message)
    assert reread.root == new_ids[0]
    assert set(reread.edges) == {(new_ids[a], new_ids[b], kind) for a, b, kind in keyframes.edges}
    for key in keyframes.keyframes:
        np.testing.assert_allclose(reread.poses[new_ids[key]], keyframes.poses[key], atol=1e-12)
        np.testing.assert_array_equal(
            reread.keyframes[new_ids[key]].points_m, keyframes.keyframes[key].points_m
        )
    edge = reread.edges[new_ids[0], new_ids[1], ODOMETRY]
    np.testing.assert_allclose(
        edge.covariance, keyframes.edges[0, 1, ODOMETRY].covariance, rtol=1e-3, atol=1e-7
    )


def test_an_imported_map_is_a_separate_component(rng: np.random.Generator) -> None:
    keyframes, _ = square(rng)
    second_map, _ = square(rng)
    message = second_map.to_message(
        frame="minnie/slam", sensor="minnie/lidar", producer="test", position=None
    )
    new_ids = keyframes.add_message(message)
    assert len(keyframes) == 32
    assert keyframes.root == 0
    assert keyframes.component(0).isdisjoint(new_ids.values())


def test_removing_the_loops_of_a_keyframe_keeps_its_odometry(rng: np.random.Generator) -> None:
    keyframes, true_poses = square(rng)
    keyframes.add_loop(0, 15, uncertain(se3.inverse(true_poses[0]) @ true_poses[15]))
    keyframes.add_loop(1, 14, uncertain(se3.inverse(true_poses[1]) @ true_poses[14]))
    keyframes.remove_loops(15)
    assert {e for e in keyframes.edges if e[2] == LOOP_CLOSURE} == {(1, 14, LOOP_CLOSURE)}
    assert (14, 15, ODOMETRY) in keyframes.edges
