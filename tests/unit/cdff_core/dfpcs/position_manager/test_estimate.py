# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The state of the filter: corrections reach clones, and links to the estimate before are those of both together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfpcs.position_manager.buffers import ImuBuffer
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimate import CORE, LINE, POSE, Estimate
from cdff_core.dfpcs.position_manager.estimator import Estimator, Event, _corrected, first_estimate
from cdff_core.dfpcs.position_manager.time_line import TimeLine

SEEN = UncertainTransform.identity()
SLOTS = {
    "prediction": ("kalman_prediction", None), "correction": ("kalman_correction", None),
    "fix_correction": ("kalman_correction", None), "weighting": ("pose_weighting", None),
    "wheel_increment": ("odometry_increment", "DistanceModel"),
    "visual_increment": ("odometry_increment", "CovarianceDifference"),
    "lidar_increment": ("odometry_increment", "CovarianceDifference"),
    "interpolation": ("frame_interpolation", None),
}  # fmt: skip


def dfn(slot: str):  # type: ignore[no-untyped-def]
    node = Registry.default().make_dfn(*SLOTS[slot])
    node.configure()
    return node


def fixed(estimate: Estimate, covariance: np.ndarray, weighting: str, T_site_map: np.ndarray) -> Estimate:
    """After a fix of where the robot is thought to be, in a frame of a map."""
    config = PositionManagerConfig(fix_weighting=weighting)  # type: ignore[arg-type]
    estimator = Estimator(config, dfn, ImuBuffer(1), lambda *_: np.eye(4), lambda _frame: T_site_map)
    measured = UncertainTransform(se3.inverse(T_site_map) @ estimate.pose, covariance)
    after, verdict = estimator.after(estimate, Event(estimate.stamp_ns, "fix", measured, "site/map"))
    assert verdict.taken
    return after


@pytest.fixture
def estimate(rng: np.random.Generator) -> Estimate:
    """Two clones, all errors correlated with each other and with those of the estimate before."""
    T = UncertainTransform(se3.exp_se3(rng.standard_normal(6)))
    first = first_estimate(0, T, 1.0, np.ones(6), np.ones(3))
    both = first.cloned("odometry", SEEN).moved(np.full(CORE + 6, 0.1)).cloned("visual_odometry", SEEN)
    n = len(both.covariance)
    root = rng.standard_normal((n + len(LINE), n + len(LINE)))
    joint = root @ root.T
    return replace(both, covariance=joint[:n, :n], since=joint[:n, n:])


def test_a_correction_turns_and_shifts_every_clone_by_its_own_errors(
    estimate: Estimate, rng: np.random.Generator
) -> None:
    correction = 0.3 * rng.standard_normal(len(estimate.covariance))
    moved = estimate.moved(correction)
    parts = [(estimate.pose, moved.pose, correction[POSE])]
    parts += [
        (estimate.clones[name].pose, moved.clones[name].pose, correction[estimate.index(name)])
        for name in estimate.clones
    ]
    for before, after, error in parts:
        np.testing.assert_allclose(after[:3, 3], before[:3, 3] + error[:3])
        np.testing.assert_allclose(after[:3, :3], se3.exp_so3(error[3:]) @ before[:3, :3])


@pytest.mark.parametrize("name", ["visual_odometry", "lidar_odometry"])
def test_a_clone_has_the_errors_of_the_pose_of_now(estimate: Estimate, name: str) -> None:
    cloned = estimate.cloned(name, SEEN)
    at = cloned.index(name)
    np.testing.assert_array_equal(cloned.covariance[at], cloned.covariance[POSE])
    np.testing.assert_array_equal(cloned.covariance[:, at], cloned.covariance[:, POSE])
    np.testing.assert_array_equal(cloned.since[at], cloned.since[POSE])
    np.testing.assert_array_equal(cloned.covariance[:CORE, :CORE], estimate.covariance[:CORE, :CORE])


def test_a_correction_changes_the_link_to_the_estimate_before_as_that_of_both_together(
    estimate: Estimate, rng: np.random.Generator
) -> None:
    n = len(estimate.covariance)
    H, noise = rng.standard_normal((6, n)), np.eye(6)
    corrected = _corrected(estimate, dfn("correction"), 0.1 * np.ones(6), H, noise)
    P0 = 100.0 * np.eye(len(LINE))
    joint = np.block([[estimate.covariance, estimate.since], [estimate.since.T, P0]])
    wide = np.hstack([H, np.zeros((6, len(LINE)))])
    K = joint @ wide.T @ np.linalg.inv(wide @ joint @ wide.T + noise)
    expected = joint - K @ wide @ joint
    np.testing.assert_allclose(corrected.since, expected[:n, n:], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(corrected.covariance, expected[:n, :n], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("weighting", ["kalman", "intersection"])
def test_a_fix_in_a_turned_frame_knows_best_along_the_axis_of_that_frame(weighting: str) -> None:
    start = first_estimate(0, UncertainTransform(np.eye(4), np.eye(6)), 1.0, np.ones(6), np.ones(3))
    sharp_along_x = np.diag([1e-6, 100.0, 100.0, 100.0, 100.0, 100.0])
    quarter = se3.transform(se3.exp_so3([0.0, 0.0, np.pi / 2]), [5.0, -3.0, 1.0])
    after = fixed(start, sharp_along_x, weighting, quarter)
    assert after.covariance[1, 1] < 1e-3, "x of the map is y of the site"
    assert after.covariance[0, 0] > 0.5


def test_after_an_intersected_fix_errors_hang_on_those_before_no_more_than_they_can() -> None:
    start = first_estimate(0, UncertainTransform(np.eye(4), np.eye(6)), 1.0, np.ones(6), np.ones(3))
    before = start.covariance[np.ix_(LINE, LINE)]
    after = fixed(start, 1e-6 * np.eye(6), "intersection", np.eye(4))
    joint = np.block([[after.covariance, after.since], [after.since.T, before]])
    assert np.linalg.eigvalsh(joint)[0] > -1e-9


def test_a_motion_between_estimates_that_stay_is_as_sure_after_thinning() -> None:
    line, step = TimeLine(dfn("interpolation"), 30_000_000_000), np.diag([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    at = first_estimate(0, UncertainTransform(np.eye(4), step), 1.0, np.ones(6), np.ones(3))
    line.append(at)
    for k in range(1, 9):
        grown = at.covariance.copy()
        grown[POSE, POSE] += step
        at = replace(at, stamp_ns=k * 250_000_000, covariance=grown, since=at.covariance[:, LINE])
        line.append(at)
    whole = line.motion(0, at.stamp_ns).covariance
    line.thin(at.stamp_ns, 1_000_000_000, 0)
    assert line.stamps_ns == [0, 1_000_000_000, 2_000_000_000]
    np.testing.assert_allclose(line.motion(0, at.stamp_ns).covariance, whole, rtol=1e-6)
    np.testing.assert_allclose(np.diagonal(whole), 8.0 * np.diagonal(step), rtol=1e-6)
