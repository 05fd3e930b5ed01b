# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of mounts and stamps: their covariance, and drives with sensors that are not mounted as stated."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Status
from cdff_common.types import IMUSensors
from cdff_core.dfpcs.position_manager.compound import PositionManager
from cdff_core.dfpcs.position_manager.configuration import MountParameters
from cdff_core.dfpcs.position_manager.estimate import MOUNTS, Estimate
from cdff_core.dfpcs.position_manager.frame_tree import RobotFrames
from cdff_core.dfpcs.position_manager.mount_errors import MountErrors, increment_jacobian
from tests.support.position_manager_samples import (
    T0,
    T_SITE_ODOM,
    error_m,
    feed,
    imu,
    manager,
    pose,
    poses,
    times,
    true_pose,
    visual,
    wheels,
)

EXACT = {"imu_sigma_deg": 0.0, "sensor_sigma_deg": 0.0, "sensor_sigma_m": 0.0}
TURN = se3.exp_se3([0.4, 0.1, 0.0, 0.1, -0.2, 0.6])


def rotated_imu(t_s: float, degrees: float) -> Sample:
    """Return a sample of an IMU that is rotated about y from its stated mount."""
    exact = imu(t_s, np.eye(3))
    R = se3.exp_so3(np.radians([0.0, degrees, 0.0]))
    value = IMUSensors(exact.value.timestamp, R @ exact.value.acc, R @ exact.value.gyro, np.zeros(3))
    return Sample("imu", exact.stamp_ns, 0, value)


def squared_end_error(dfpc: PositionManager, samples: list[Sample]) -> float:
    """Return the squared error of the last orientation and height, normalised by their covariance."""
    last = poses(feed(dfpc, samples))[-1]
    expected = T_SITE_ODOM @ true_pose((last.t1_ns - T0) * 1e-9)
    rows = np.array([2, 3, 4, 5])
    error = pose_error(expected, last.value.transform.matrix)[rows]
    return float(error @ np.linalg.solve(last.value.transform.covariance[np.ix_(rows, rows)], error))


def test_a_stated_covariance_replaces_the_default() -> None:
    graph = FrameGraph()
    stated_covariance = np.diag(np.square([0.01] * 3 + [0.02] * 3))
    graph.set_static("mana/base", "mana/mast", UncertainTransform(np.eye(4), stated_covariance))
    graph.set_static("mana/mast", "mana/camera", UncertainTransform.exact(np.eye(4)))
    graph.set_static("mana/base", "mana/lidar", UncertainTransform.exact(np.eye(4)))
    mounts = MountErrors(MountParameters(), RobotFrames("mana", graph, ""))
    np.testing.assert_allclose(mounts.covariance("mana/camera", 0), stated_covariance)
    np.testing.assert_allclose(mounts.covariance("mana/lidar", 0)[3:, 3:], np.radians(0.2) ** 2 * np.eye(3))
    assert not mounts.covariance("mana/base", 0).any()


@pytest.mark.parametrize(
    ("degrees", "reasons"), [(0.4, ()), (1.5, ("mount_error:visual_odometry_1.50_deg",))]
)
def test_a_mount_that_differs_by_more_than_its_stated_covariance_allows_is_reported(
    degrees: float, reasons: tuple[str, ...]
) -> None:
    graph = FrameGraph()
    graph.set_static("mana/base", "mana/camera", UncertainTransform.exact(np.eye(4)))
    mounts = MountErrors(MountParameters(), RobotFrames("mana", graph, ""))
    start = UncertainTransform(np.eye(4), np.eye(6))
    estimate = Estimate.at_start(0, start, 0.1, np.zeros(6), np.ones(9))
    first = MOUNTS["visual_odometry"].start - MOUNTS["imu"].start
    estimate.calibration[first + 2] = np.radians(degrees)
    assert mounts.deviations(estimate, {"visual_odometry": "mana/camera"}) == reasons


def test_a_displaced_camera_is_a_reason_of_the_poses_and_a_correct_one_is_not() -> None:
    """The head is turned by 4 degrees about y; data of wheels and IMU are exact."""
    first = [wheels(t) for t in times(10, 15)] + [imu(t, np.eye(3)) for t in times(50, 15)]
    for degrees, is_reported in ((0.0, False), (4.0, True)):
        images = [visual(t, mount=se3.exp_so3(np.radians([0, degrees, 0]))) for t in times(4, 15)]
        reasons = poses(feed(manager(), [*first, *images]))[-1].quality.reasons
        assert any(reason.startswith("mount_error:") for reason in reasons) is is_reported


def test_the_jacobian_of_an_increment_agrees_with_differences_of_the_mount(rng: np.random.Generator) -> None:
    mount = se3.exp_se3([0.3, 0.1, 0.9, -1.2, 1.2, -1.1])
    sensor_step = se3.inverse(mount) @ TURN @ mount
    error = 1e-6 * rng.standard_normal(6)
    T_moved = se3.transform(se3.exp_so3(error[3:]) @ mount[:3, :3], mount[:3, 3] + error[:3])
    changed = pose_error(T_moved @ sensor_step @ se3.inverse(T_moved), TURN)
    np.testing.assert_allclose(increment_jacobian(TURN, mount[:3, 3]) @ error, changed, atol=1e-10)


def test_a_rotated_imu_is_within_the_covariance_only_if_its_mount_is_uncertain() -> None:
    samples = [wheels(t) for t in times(10, 12)] + [rotated_imu(t, 0.6) for t in times(100, 12)]
    assert squared_end_error(manager(), samples) < 9.5  # 95 % quantile of χ² with 4 degrees of freedom
    assert squared_end_error(manager(mounts=EXACT), samples) > 18.5  # 99.9 %


def test_exact_mounts_do_not_add_to_the_covariance_of_the_start() -> None:
    samples = [wheels(t) for t in times(10, 2)] + [imu(t, np.eye(3)) for t in times(100, 2)]
    tilt = [
        poses(feed(dfpc, samples))[0].value.transform.covariance[3, 3]
        for dfpc in (manager(), manager(mounts=EXACT))
    ]
    assert tilt[0] - tilt[1] == pytest.approx(np.radians(0.5) ** 2, rel=0.02)


def test_an_unknown_offset_of_the_stamps_is_in_the_covariance_while_the_robot_moves() -> None:
    """All odometries are late by 60 ms, which displaces the pose along the path by 24 mm."""
    samples = [imu(t, np.eye(3)) for t in times(100, 6)]
    for sample in [
        *(wheels(t - 0.06) for t in times(10, 6, 0.1)),
        *(visual(t - 0.06) for t in times(4, 6, 0.25)),
    ]:
        stamp_ns = sample.stamp_ns + 60_000_000
        samples.append(Sample(sample.port, stamp_ns, 0, sample.value, quality=sample.quality))
    last = poses(feed(manager(), samples))[-1]
    expected = T_SITE_ODOM @ true_pose((last.t1_ns - T0) * 1e-9)
    error, C = pose_error(expected, last.value.transform.matrix), last.value.transform.covariance
    forward = expected[:3, 0]
    assert abs(error[:3] @ forward) < 3.0 * np.sqrt(forward @ C[:3, :3] @ forward)


def test_the_offset_of_the_stamps_survives_a_restart() -> None:
    samples = [wheels(t) for t in times(10, 3)] + [imu(t, np.eye(3)) for t in times(100, 3)]
    stopped, restarted = manager(), manager()
    stopped.stamps.applied_s["odometry"] = -0.08
    feed(stopped, samples)
    restarted.resume(stopped.state())
    assert restarted.stamps.applied_s == {"odometry": -0.08}
    assert np.array_equal(restarted._history.newest.calibration, stopped._history.newest.calibration)


def test_wheels_that_slip_for_half_a_second_do_not_displace_the_pose() -> None:
    """Several increments of the wheels are refused before the next pose of the camera."""
    samples = [imu(t, np.eye(3)) for t in times(100, 8)] + [visual(t) for t in times(1, 8)]
    for t in times(10, 8):
        slip_m = 0.4 * min(max(t - 5.2, 0.0), 0.5)
        T = true_pose(t) @ se3.transform(np.eye(3), [slip_m, 0.0, 0.0])
        samples.append(pose("odometry", t, T, None, "mana/odom", "mana/base", Status.OK))
    assert max(map(error_m, poses(feed(manager(), samples)))) < 0.05
