# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion between two times from buffered odometry poses."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import OdometryBuffer, UncertainTransform, se3

S = 1_000_000_000


def pose_at(t_s: float) -> np.ndarray:
    """Return the pose of a base on a circle at constant speed."""
    return se3.exp_se3(t_s * np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.1]))


def buffer(until_s: float, limit_s: float = 0.3, memory_s: float = 60.0) -> OdometryBuffer:
    out = OdometryBuffer(round(memory_s * S), round(limit_s * S))
    for k in range(round(until_s * 10) + 1):
        out.insert(k * S // 10, UncertainTransform(pose_at(k / 10), 0.01 * np.eye(6)))
    return out


def test_motion_between_two_times_is_interpolated() -> None:
    motion = buffer(2.0).motion(95 * S // 100, 3 * S // 2)
    np.testing.assert_allclose(motion, se3.inverse(pose_at(0.95)) @ pose_at(1.5), atol=2e-4)


def test_poses_after_the_newest_are_extrapolated_at_constant_velocity_up_to_the_limit() -> None:
    odometry = buffer(2.0)
    pose = odometry.pose(23 * S // 10)
    assert pose is not None
    assert pose.covariance is None
    np.testing.assert_allclose(pose.matrix, pose_at(2.3), atol=1e-9)
    assert odometry.pose(23 * S // 10 + 1) is None


def test_a_single_pose_is_extrapolated_without_motion() -> None:
    pose = buffer(0.0).pose(S // 10)
    assert pose is not None
    np.testing.assert_array_equal(pose.matrix, np.eye(4))


def test_velocity_is_the_mean_over_the_window_and_unknown_without_poses() -> None:
    np.testing.assert_allclose(buffer(2.0).velocity(2 * S), [1.0, 0.01, 0.0, 0.0, 0.0, 0.1], atol=1e-4)
    assert buffer(0.0).velocity(0) is None
    assert OdometryBuffer(S).motion(0, 0) is None


def test_old_poses_are_evicted_and_clear_removes_all() -> None:
    odometry = buffer(5.0, memory_s=1.0)
    assert odometry.stamps_ns[0] == 4 * S - S // 10
    assert odometry.pose(3 * S) is None
    odometry.clear()
    assert odometry.pose(5 * S) is None
