# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Filter state of the position manager: corrections of clones, and correlation with earlier estimates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimate import (
    CORE_SIZE,
    OFFSETS,
    POSE,
    POSITION,
    ROTATION,
    TIMELINE_ERRORS,
    VELOCITY,
    Estimate,
)
from cdff_core.dfpcs.position_manager.estimator import Estimator
from cdff_core.dfpcs.position_manager.frame_tree import RobotFrames
from cdff_core.dfpcs.position_manager.imu_buffer import ImuBuffer
from cdff_core.dfpcs.position_manager.measurement import Measurement
from cdff_core.dfpcs.position_manager.pose_timeline import PoseTimeline
from cdff_core.dfpcs.position_manager.wheel_correction import kalman_corrected

IDENTITY = UncertainTransform.identity()
SLOTS = {
    "prediction": ("kalman_prediction", None),
    "correction": ("kalman_correction", None),
    "fix_correction": ("kalman_correction", None),
    "weighting": ("pose_weighting", None),
    "wheel_increment": ("odometry_increment", "DistanceModel"),
    "visual_increment": ("odometry_increment", "CovarianceDifference"),
    "lidar_increment": ("odometry_increment", "CovarianceDifference"),
    "interpolation": ("frame_interpolation", None),
}


def dfn(slot: str):  # type: ignore[no-untyped-def]
    node = Registry.default().make_dfn(*SLOTS[slot])
    node.configure()
    return node


def estimate_after_fix(
    estimate: Estimate,
    covariance: np.ndarray,
    weighting: str,
    T_site_map: np.ndarray,
    displacement_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Estimate:
    """Return the estimate after a fix in the frame of a map, displaced from the estimated pose."""
    graph = FrameGraph()
    graph.set_static("site", "site/map", UncertainTransform(T_site_map))
    config = PositionManagerConfig(fixes={"weighting": weighting})  # type: ignore[arg-type]
    estimator = Estimator(config, dfn, ImuBuffer(1), RobotFrames("mana", graph, ""))
    T_site_base = se3.transform(estimate.pose[:3, :3], estimate.pose[:3, 3] + displacement_m)
    measured = UncertainTransform(se3.inverse(T_site_map) @ T_site_base, covariance)
    fix = Measurement(estimate.stamp_ns, "fix", measured, "site/map", "mana/base")
    after, result = estimator.update(estimate, fix)
    assert result.used
    return after


@pytest.fixture
def estimate(rng: np.random.Generator) -> Estimate:
    """Return an estimate with two clones, all errors correlated, also with the previous estimate."""
    T = UncertainTransform(se3.exp_se3(rng.standard_normal(6)))
    first = Estimate.at_start(0, T, 1.0, np.zeros(6), np.ones(9))
    with_clones = (
        first.with_clone("odometry", IDENTITY)
        .with_correction(np.full(CORE_SIZE + 6, 0.1))
        .with_clone("visual_odometry", IDENTITY)
    )
    n = len(with_clones.covariance)
    root = rng.standard_normal((n + len(TIMELINE_ERRORS), n + len(TIMELINE_ERRORS)))
    joint = root @ root.T
    return replace(with_clones, covariance=joint[:n, :n], cross_covariance=joint[:n, n:])


def test_a_correction_transforms_every_clone_by_its_own_errors(
    estimate: Estimate, rng: np.random.Generator
) -> None:
    correction = 0.3 * rng.standard_normal(len(estimate.covariance))
    corrected = estimate.with_correction(correction)
    poses_and_errors = [(estimate.pose, corrected.pose, correction[POSE])]
    poses_and_errors += [
        (estimate.clones[name].pose, corrected.clones[name].pose, correction[estimate.clone_errors(name)])
        for name in estimate.clones
    ]
    for before, after, error in poses_and_errors:
        np.testing.assert_allclose(after[:3, 3], before[:3, 3] + error[:3])
        np.testing.assert_allclose(after[:3, :3], se3.exp_so3(error[3:]) @ before[:3, :3])


@pytest.mark.parametrize("name", ["visual_odometry", "lidar_odometry"])
def test_a_clone_has_the_errors_of_the_current_pose(estimate: Estimate, name: str) -> None:
    cloned = estimate.with_clone(name, IDENTITY)
    rows = cloned.clone_errors(name)
    np.testing.assert_array_equal(cloned.covariance[rows], cloned.covariance[POSE])
    np.testing.assert_array_equal(cloned.covariance[:, rows], cloned.covariance[:, POSE])
    np.testing.assert_array_equal(cloned.cross_covariance[rows], cloned.cross_covariance[POSE])
    np.testing.assert_array_equal(
        cloned.covariance[:CORE_SIZE, :CORE_SIZE], estimate.covariance[:CORE_SIZE, :CORE_SIZE]
    )


def test_a_correction_updates_the_correlation_with_the_previous_estimate(
    estimate: Estimate, rng: np.random.Generator
) -> None:
    n = len(estimate.covariance)
    H, noise = rng.standard_normal((6, n)), np.eye(6)
    corrected = kalman_corrected(estimate, dfn("correction"), 0.1 * np.ones(6), H, noise)
    P0 = 100.0 * np.eye(len(TIMELINE_ERRORS))
    joint = np.block([[estimate.covariance, estimate.cross_covariance], [estimate.cross_covariance.T, P0]])
    H_joint = np.hstack([H, np.zeros((6, len(TIMELINE_ERRORS)))])
    K = joint @ H_joint.T @ np.linalg.inv(H_joint @ joint @ H_joint.T + noise)
    K[[*OFFSETS.values()]] = 0.0
    K[n:] = 0.0
    A = np.eye(len(joint)) - K @ H_joint
    expected = A @ joint @ A.T + K @ noise @ K.T
    J = invariant_errors(corrected) @ np.linalg.inv(invariant_errors(estimate))
    np.testing.assert_allclose(corrected.cross_covariance, J @ expected[:n, n:], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(corrected.covariance, J @ expected[:n, :n] @ J.T, rtol=1e-6, atol=1e-8)


def invariant_errors(estimate: Estimate) -> np.ndarray:
    """Return the Jacobian of the errors with respect to the right-invariant ones: ``dp = xi + phi x p``."""
    J = np.eye(len(estimate.covariance))
    J[POSITION, ROTATION] = -se3.skew(estimate.pose[:3, 3])
    J[VELOCITY, ROTATION] = -se3.skew(estimate.velocity)
    for name, clone in estimate.clones.items():
        k = estimate.clone_errors(name).start
        J[k : k + 3, k + 3 : k + 6] = -se3.skew(clone.pose[:3, 3])
    return J


def test_increments_and_forces_give_no_information_about_the_heading_of_the_site(estimate: Estimate) -> None:
    """A rotation about the vertical remains an error without effect on the predicted increment."""
    up = np.zeros(len(estimate.covariance))
    up[[5, *(estimate.clone_errors(name).start + 5 for name in estimate.clones)]] = 1.0
    rotation = invariant_errors(estimate) @ up
    _, H = estimate.relative_motion("odometry")
    np.testing.assert_allclose(H @ rotation, 0.0, atol=1e-12)
    covariance = estimate.covariance + 1e4 * np.outer(rotation, rotation)
    before = replace(estimate, covariance=covariance)
    after = kalman_corrected(before, dfn("correction"), 0.01 * np.ones(6), H, 1e-2 * np.eye(6))
    unknown = invariant_errors(after) @ up
    information = unknown @ np.linalg.solve(after.covariance, unknown)
    assert information == pytest.approx(1e-4, rel=0.1)


@pytest.mark.parametrize("weighting", ["kalman", "intersection"])
def test_the_covariance_of_a_fix_is_rotated_from_its_frame(weighting: str) -> None:
    start = Estimate.at_start(0, UncertainTransform(np.eye(4), np.eye(6)), 1.0, np.zeros(6), np.ones(9))
    precise_along_x = np.diag([1e-6, 100.0, 100.0, 100.0, 100.0, 100.0])
    T_site_map = se3.transform(se3.exp_so3([0.0, 0.0, np.pi / 2]), [5.0, -3.0, 1.0])
    after = estimate_after_fix(start, precise_along_x, weighting, T_site_map)
    assert after.covariance[1, 1] < 1e-3, "the x axis of the map is the y axis of the site"
    assert after.covariance[0, 0] > 0.5


@pytest.mark.parametrize("weighting", ["kalman", "intersection"])
def test_the_covariance_after_a_fix_does_not_depend_on_the_measured_position(weighting: str) -> None:
    start = Estimate.at_start(0, UncertainTransform(np.eye(4), np.eye(6)), 1.0, np.zeros(6), np.ones(9))
    agreeing, displaced = (
        estimate_after_fix(start, 0.5 * np.eye(6), weighting, np.eye(4), displacement_m)
        for displacement_m in ((0.0, 0.0, 0.0), (1.0, -0.5, 0.2))
    )
    assert displaced.pose[0, 3] > agreeing.pose[0, 3] + 0.5
    np.testing.assert_allclose(displaced.covariance, agreeing.covariance, atol=1e-12)
    np.testing.assert_allclose(displaced.cross_covariance, agreeing.cross_covariance, atol=1e-12)


def test_an_intersected_fix_leaves_a_valid_joint_covariance() -> None:
    start = Estimate.at_start(0, UncertainTransform(np.eye(4), np.eye(6)), 1.0, np.zeros(6), np.ones(9))
    before = start.covariance[np.ix_(TIMELINE_ERRORS, TIMELINE_ERRORS)]
    after = estimate_after_fix(start, 1e-6 * np.eye(6), "intersection", np.eye(4))
    joint = np.block([[after.covariance, after.cross_covariance], [after.cross_covariance.T, before]])
    assert np.linalg.eigvalsh(joint)[0] > -1e-9


def test_thinning_does_not_change_the_covariance_of_a_motion() -> None:
    timeline, step = (
        PoseTimeline(dfn("interpolation"), 30_000_000_000),
        np.diag([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]),
    )
    estimate = Estimate.at_start(0, UncertainTransform(np.eye(4), step), 1.0, np.zeros(6), np.ones(9))
    timeline.append(estimate)
    for k in range(1, 9):
        grown = estimate.covariance.copy()
        grown[POSE, POSE] += step
        estimate = replace(
            estimate,
            stamp_ns=k * 250_000_000,
            covariance=grown,
            cross_covariance=estimate.covariance[:, TIMELINE_ERRORS],
        )
        timeline.append(estimate)
    before_thinning = timeline.motion(0, estimate.stamp_ns).covariance
    timeline.thin(estimate.stamp_ns, 1_000_000_000, 0)
    assert timeline.stamps_ns == [0, 1_000_000_000, 2_000_000_000]
    np.testing.assert_allclose(timeline.motion(0, estimate.stamp_ns).covariance, before_thinning, rtol=1e-6)
    np.testing.assert_allclose(np.diagonal(before_thinning), 8.0 * np.diagonal(step), rtol=1e-6)


def test_the_displacement_of_refused_increments_is_not_attributed_to_the_last_moment() -> None:
    imu = ImuBuffer(10_000_000_000)
    imu.T_base_imu = np.eye(4)
    for k in range(201):
        imu.insert(k * 10_000_000, np.array([0.0, 0.0, 9.81]), np.zeros(3))
    graph = FrameGraph()
    graph.set_static("mana/base", "mana/imu", UncertainTransform.exact(np.eye(4)))
    estimator = Estimator(PositionManagerConfig(), dfn, imu, RobotFrames("mana", graph, ""))
    estimator.gravity_m_s2 = 9.81
    start = UncertainTransform(np.eye(4), 1e-8 * np.eye(6))
    covariance = 1e-6 * np.eye(6)
    at_rest = Estimate.at_start(0, start, 0.01, np.zeros(6), np.full(9, 1e-3))
    for source in ("odometry", "visual_odometry"):
        at_rest = at_rest.with_clone(source, UncertainTransform(np.eye(4), covariance)).with_refusal(source)
    turned = UncertainTransform(se3.transform(se3.exp_so3([0.0, 0.0, 3.0]), [0.0, 0.0, 0.0]), covariance)
    moved = UncertainTransform(se3.transform(np.eye(3), [0.5, 0.0, 0.0]), covariance)
    unknown, result = estimator.update(
        replace(at_rest, consecutive_refusals=3),
        Measurement(1_690_000_000, "odometry", turned, "mana/odom", "mana/base"),
    )
    assert result.is_refused
    after, result = estimator.update(
        unknown, Measurement(1_700_000_000, "visual_odometry", moved, "mana/vo", "mana/base")
    )
    assert result.used
    assert after.pose[0, 3] == pytest.approx(0.5, abs=0.01)
    assert 0.0 < after.velocity[0] < 2 * 0.5 / 1.7


def test_a_motion_can_end_at_a_clone(estimate: Estimate) -> None:
    estimate = estimate.with_correction(np.linspace(0.1, 0.2, len(estimate.covariance)))
    T, H = estimate.relative_motion("odometry", "visual_odometry")
    start, end = estimate.clones["odometry"].pose, estimate.clones["visual_odometry"].pose
    np.testing.assert_allclose(T, se3.inverse(start) @ end, atol=1e-12)
    np.testing.assert_array_equal(H[:, POSE], 0.0)
    errors = 1e-6 * np.ones(len(estimate.covariance))
    moved, _ = estimate.with_correction(errors).relative_motion("odometry", "visual_odometry")
    np.testing.assert_allclose(moved[:3, 3] - T[:3, 3], H[:3] @ errors, rtol=1e-3, atol=1e-10)
