# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_core.dfpcs.lidar_slam.keyframe_map import KeyframeMap
from cdff_core.keyframe_graph.trajectory import Trajectory


def pose_at(x_m: float) -> UncertainTransform:
    return UncertainTransform(se3.transform(np.eye(3), [x_m, 0.0, 0.0]), 1e-4 * np.eye(6))


def test_poses_move_with_the_keyframe_they_are_relative_to() -> None:
    keyframes, trajectory = KeyframeMap(), Trajectory()
    key = keyframes.start_component(0, np.eye(4))
    trajectory.append(1000, key, pose_at(1.0))
    keyframes.poses[key] = se3.transform(np.eye(3), [0.0, 5.0, 0.0])
    stamps, poses, covariances = trajectory.in_map(keyframes, -1, -1)
    assert stamps.tolist() == [1000]
    np.testing.assert_allclose(poses[0, :3, 3], [1.0, 5.0, 0.0])
    np.testing.assert_allclose(covariances[0], 1e-4 * np.eye(6))


def test_beyond_the_capacity_every_second_pose_of_the_older_half_is_removed() -> None:
    keyframes, trajectory = KeyframeMap(), Trajectory(capacity=8)
    key = keyframes.start_component(0, np.eye(4))
    for i in range(9):
        trajectory.append(1000 * i, key, pose_at(float(i)))
    assert trajectory.in_map(keyframes, -1, -1)[0].tolist() == [0, 2000, *range(4000, 9000, 1000)]


def test_poses_at_an_unlinked_keyframe_are_not_in_the_map() -> None:
    keyframes, trajectory = KeyframeMap(), Trajectory()
    keyframes.start_component(0, np.eye(4))
    trajectory.append(1000, keyframes.start_component(1000, np.eye(4)), pose_at(0.0))
    assert not trajectory.is_localised(keyframes)
    assert len(trajectory.in_map(keyframes, -1, -1)[0]) == 0
