# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import LidarScan
from cdff_core.dfpcs.lidar_slam.configuration import MotionPrediction
from cdff_core.dfpcs.lidar_slam.motion_predictor import MotionPredictor
from cdff_core.dfpcs.lidar_slam.motion_uncertainty import MotionUncertainty

NS_PER_S = 1_000_000_000
MOUNT = se3.transform(se3.exp_so3(np.array([0.0, 0.0, 0.3])), np.array([0.5, 0.0, 1.0]))


def base_pose(t_s: float) -> np.ndarray:
    """Return the pose of a base on a circle at constant velocity."""
    return se3.exp_se3(t_s * np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.1]))


def predictor_until(until_s: float, max_age_s: float = 0.3) -> MotionPredictor:
    predictor = MotionPredictor(MotionPrediction(odometry_max_age_s=max_age_s), MOUNT)
    for k in range(round(until_s * 10) + 1):
        predictor.insert(k * NS_PER_S // 10, UncertainTransform(base_pose(k / 10)))
    return predictor


def test_the_increment_is_that_of_the_lidar() -> None:
    predictor = predictor_until(2.0)
    assert predictor.increment(NS_PER_S) is None  # the first sweep has no increment
    increment = predictor.increment(3 * NS_PER_S // 2)
    assert increment is not None
    expected = se3.inverse(base_pose(1.0) @ MOUNT) @ base_pose(1.5) @ MOUNT
    np.testing.assert_allclose(increment, expected, atol=1e-4)  # interpolated along chords


def test_increments_with_extrapolation_add_up_to_the_motion() -> None:
    """The odometry at the end of a sweep arrives after the sweep, so that its pose is extrapolated."""
    predictor, T = MotionPredictor(MotionPrediction(), np.eye(4)), np.eye(4)
    for sweep in range(1, 21):
        for k in range(5 * (sweep - 1), 5 * sweep):
            predictor.insert(k * NS_PER_S // 10, UncertainTransform(base_pose(k / 10)))
        increment = predictor.increment(sweep * NS_PER_S // 2)
        if increment is not None:
            T = T @ increment
    np.testing.assert_allclose(T, se3.inverse(base_pose(0.5)) @ base_pose(10.0), atol=1e-9)


def test_outdated_odometry_yields_no_increment() -> None:
    predictor = predictor_until(2.0, max_age_s=0.3)
    predictor.increment(NS_PER_S)
    assert predictor.increment(5 * NS_PER_S // 2) is None
    assert predictor.increment(3 * NS_PER_S) is None  # the previous pose is missing


def test_before_the_first_odometry_pose_there_is_no_increment() -> None:
    predictor = MotionPredictor(MotionPrediction(), np.eye(4))
    assert predictor.increment(NS_PER_S) is None
    predictor.insert(3 * NS_PER_S, UncertainTransform(np.eye(4)))
    assert predictor.increment(2 * NS_PER_S) is None


def test_the_velocity_is_that_of_the_lidar_and_unknown_without_poses() -> None:
    velocity = predictor_until(2.0).velocity(2 * NS_PER_S)
    assert velocity is not None
    expected = se3.inverse(MOUNT) @ se3.exp_se3(np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.02])) @ MOUNT
    np.testing.assert_allclose(velocity[:3], expected[:3, 3] / 0.2, atol=1e-6)
    np.testing.assert_allclose(velocity[3:], [0.0, 0.0, 0.1], atol=1e-6)
    assert predictor_until(0.0).velocity(0) is None


def test_a_sweep_predicted_again_for_a_restart_keeps_the_motion_during_it() -> None:
    predictor, velocity = predictor_until(2.0), np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.1])
    scan = LidarScan.from_arrays(
        np.ones((2, 3)),
        np.array([0, 100_000]),
        t0_ns=NS_PER_S,
        t1_ns=NS_PER_S + NS_PER_S // 10,
        frame="r/lidar",
    )
    first, second = (predictor.predict(scan, None, velocity, MotionUncertainty()) for _ in range(2))
    np.testing.assert_allclose(first.T_previous_current[0, 3], 0.1, atol=1e-3)
    np.testing.assert_allclose(second.T_previous_current, np.eye(4), atol=1e-12)
    np.testing.assert_array_equal(second.T_end_start, first.T_end_start)
