# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion between two times by odometry, or at constant velocity without it."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.registry import Registry
from cdff_common.types import TransformWithCovariance
from cdff_core.dfpcs.lidar_localisation.configuration import LidarLocalisationConfig
from cdff_core.dfpcs.lidar_localisation.motion_prior import MotionPrior

S = 1_000_000_000


@pytest.fixture
def prior() -> MotionPrior:
    increment = Registry.default().make_dfn("odometry_increment", "CovarianceDifference")
    increment.configure()
    return MotionPrior(increment, LidarLocalisationConfig())


def odometry(stamp_ns: int, x_m: float, child: str = "mana/base") -> TransformWithCovariance:
    T = UncertainTransform(se3.transform(np.eye(3), [x_m, 0.0, 0.0]), 1e-4 * max(x_m, 1e-3) * np.eye(6))
    return TransformWithCovariance.from_transform(T, parent="mana/odom", child=child, stamp_ns=stamp_ns)


def test_the_newest_stamp_is_that_of_the_odometry_in_its_current_frames(prior: MotionPrior) -> None:
    assert prior.last_ns is None
    for second in (1, 2):
        prior.insert(second * S, odometry(second * S, 0.5 * second), np.eye(4))
    assert prior.last_ns == 2 * S
    prior.insert(S, odometry(S, 0.5, "mana/other"), np.eye(4))
    assert prior.last_ns == S


def test_the_motion_is_that_of_the_odometry(prior: MotionPrior) -> None:
    for second in range(4):
        prior.insert(second * S, odometry(second * S, 0.5 * second), np.eye(4))
    motion = prior.between(S, 3 * S)
    np.testing.assert_allclose(motion.matrix[:3, 3], [1.0, 0.0, 0.0], atol=1e-9)
    sigmas = np.sqrt(np.diagonal(motion.covariance))
    assert (sigmas[:3] >= 0.02).all()
    assert (sigmas[3:] >= np.radians(0.3) - 1e-12).all()
    assert (sigmas < 0.1).all()


def test_without_odometry_the_last_velocity_continues_until_the_poses_are_cleared(
    prior: MotionPrior,
) -> None:
    for second in (1, 2):
        prior.add_pose(second * S, se3.transform(np.eye(3), [0.5 * second, 0.0, 0.0]))
    np.testing.assert_allclose(prior.between(2 * S, 4 * S).matrix[:3, 3], [1.0, 0.0, 0.0], atol=1e-9)
    prior.clear_poses()
    np.testing.assert_allclose(prior.between(2 * S, 4 * S).matrix, np.eye(4), atol=1e-9)


def test_the_uncertainty_without_odometry_grows_with_the_interval(prior: MotionPrior) -> None:
    config = LidarLocalisationConfig()
    for interval_s in (1, 3):
        variances = np.diagonal(prior.between(4 * S, (4 - interval_s) * S).covariance)
        drift_m, drift_rad = config.drift_m_s * interval_s, np.radians(config.drift_deg_s) * interval_s
        np.testing.assert_allclose(variances[:3], 0.02**2 + drift_m**2, rtol=1e-9)
        np.testing.assert_allclose(variances[3:], np.radians(0.3) ** 2 + drift_rad**2, rtol=1e-9)


def test_the_poses_of_the_lidar_during_a_sweep_are_relative_to_the_base_at_its_end(
    prior: MotionPrior,
) -> None:
    T_base_lidar = se3.transform(np.eye(3), [0.0, 0.0, 1.0])
    for second in range(4):
        prior.insert(second * S, odometry(second * S, 0.5 * second), np.eye(4))
    stamps, poses = prior.lidar_poses(S // 2, 2 * S + S // 2, T_base_lidar)
    assert stamps.tolist() == [S // 2, S, 2 * S, 2 * S + S // 2]
    np.testing.assert_allclose(poses[:, :3, 3], [[x, 0.0, 1.0] for x in (-1.0, -0.75, -0.25, 0.0)], atol=1e-9)
    assert prior.lidar_poses(2 * S, 5 * S, T_base_lidar)[0].tolist() == [2 * S, 5 * S]
