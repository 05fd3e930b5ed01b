# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of trajectories: association, alignment, drift and consistency of covariances."""

from __future__ import annotations

import re

import numpy as np
import pytest

from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import se3
from cdff_common.plots import figure_bytes
from cdff_dev.compare.trajectory.alignment import Mode
from cdff_dev.compare.trajectory.compare import compare
from cdff_dev.compare.trajectory.plot import draw
from cdff_dev.compare.trajectory.report import table
from cdff_dev.compare.trajectory.track import Track

SECOND_NS = 1_000_000_000


def bend(n: int = 200, step_m: float = 1.0) -> np.ndarray:
    """Return ``n`` poses (n, 4, 4) along a winding path; consecutive poses are ``step_m`` apart."""
    motions = np.zeros((n - 1, 6))
    motions[:, 0] = step_m
    motions[:, 5] = 0.05 * np.cos(0.1 * np.arange(n - 1))
    motions[:, 4] = 0.01 * np.sin(0.07 * np.arange(n - 1))
    poses = [np.eye(4)]
    for T in se3.exp_se3(motions):
        poses.append(poses[-1] @ T)
    return np.array(poses)


def track(
    matrices: np.ndarray, covariances: np.ndarray | None = None, late_ns: int = 0, name: str = "track"
) -> Track:
    return Track(name, np.arange(len(matrices), dtype=np.int64) * SECOND_NS + late_ns, matrices, covariances)


def test_a_rigid_transform_between_trajectories_is_not_an_error() -> None:
    T = bend()
    transformed = se3.exp_se3([5.0, -3, 2, 0.3, 0.5, -1.0]) @ T
    results = compare(track(transformed), track(T)).results
    assert results["ate"]["translation_m"]["max"] < 1e-9
    assert results["ate"]["rotation_deg"]["max"] < 1e-6
    assert results["rpe"]["translation_m"]["max"] < 1e-9


@pytest.mark.parametrize(
    ("mode", "rmse"), [("none", np.sqrt(14.0)), ("origin", 0.0), ("yaw", 0.0), ("se3", 0.0)]
)
def test_only_the_requested_alignment_is_estimated(mode: str, rmse: float) -> None:
    T = bend()
    transformed = se3.transform(np.eye(3), [1.0, 2.0, 3.0]) @ T
    comparison = compare(track(transformed), track(T), align=mode).results  # type: ignore[arg-type]
    assert comparison["ate"]["translation_m"]["rmse"] == pytest.approx(rmse, abs=1e-9)


def test_yaw_alignment_keeps_tilt_as_an_error() -> None:
    T = bend()
    rotated = se3.exp_se3([0, 0, 0, 0, 0, 0.7]) @ T
    assert compare(track(rotated), track(T), align="yaw").results["ate"]["translation_m"]["max"] < 1e-9
    tilted = se3.exp_se3([0, 0, 0, 0.1, 0, 0]) @ T
    assert compare(track(tilted), track(T), align="yaw").results["ate"]["translation_m"]["rmse"] > 0.1


def test_orientations_of_a_straight_path_are_compared_after_their_own_alignment(
    rng: np.random.Generator,
) -> None:
    T = se3.transform(np.eye(3), np.arange(100.0)[:, None] * [1.0, 0.0, 0.0])
    noisy, rolled = T.copy(), T.copy()
    noisy[:, 1:3, 3] += rng.normal(0.0, 1e-3, (100, 2))
    rolled[:, 1:3, 3] += rng.normal(0.0, 1e-3, (100, 2))
    rolled[:, :3, :3] = se3.exp_so3([0.01, 0.0, 0.0]) @ se3.exp_so3(rng.normal(0.0, 1e-3, (100, 3)))
    results = compare(track(rolled), track(noisy)).results
    assert results["ate"]["rotation_aligned_deg"]["rmse"] == pytest.approx(
        np.degrees(np.sqrt(3) * 1e-3), rel=0.2
    )
    assert results["ate"]["rotation_deg"]["rmse"] > 1.0
    assert f"differs by {results['alignment']['orientations_deg']:.2f} deg" in table(results)
    assert "differs by" not in table(compare(track(rolled), track(noisy), align="none").results)


def test_a_scale_error_is_estimated_if_requested() -> None:
    T = bend()
    scaled = T.copy()
    scaled[:, :3, 3] *= 0.5
    comparison = compare(track(scaled), track(T), align="sim3").results
    assert comparison["alignment"]["scale"] == pytest.approx(2.0)
    assert comparison["ate"]["translation_m"]["max"] < 1e-9


def test_a_scale_error_of_two_percent_is_a_drift_of_two_percent() -> None:
    T = bend(400)
    longer = T.copy()
    longer[:, :3, 3] *= 1.02
    drift = compare(track(longer), track(T)).results["drift"]
    assert [s["length_m"] for s in drift["segments"]] == [100.0, 200.0, 300.0]  # the path is 399 m long
    # A segment ends when its length is first exceeded, and the chord of a bend is shorter than its path.
    assert 1.0 < drift["translation_percent"] < 2.1


def test_short_trajectories_are_evaluated_over_rover_lengths() -> None:
    drift = compare(track(bend(40)), track(bend(40))).results["drift"]
    assert [s["length_m"] for s in drift["segments"]] == [5.0, 10.0, 20.0]
    assert drift["translation_percent"] < 1e-9


def test_each_pose_is_matched_once_with_the_nearest_in_time() -> None:
    T = bend()
    sparse = Track("sparse", np.arange(0, 200, 2, dtype=np.int64) * SECOND_NS + 4_000_000, T[::2])
    assert compare(sparse, track(T)).results["poses"] == {"estimate": 100, "reference": 200, "compared": 100}
    assert compare(track(T), sparse).results["poses"]["compared"] == 100
    doubled = Track("doubled", np.sort(np.concatenate([sparse.stamps_ns, sparse.stamps_ns + 1000])), T)
    assert compare(doubled, sparse).results["poses"]["compared"] == 100


def test_trajectories_without_common_time_are_refused_with_both_intervals() -> None:
    with pytest.raises(InputError, match=r"one.*two|two.*one"):
        compare(track(bend(), name="one"), track(bend(), late_ns=500 * SECOND_NS, name="two"))


def test_collinear_positions_leave_the_rotation_undefined() -> None:
    T = np.tile(np.eye(4), (10, 1, 1))
    T[:, 0, 3] = np.arange(10)
    with pytest.raises(DegenerateGeometryError, match="yaw, origin or none"):
        compare(track(T), track(T))


def test_consistent_covariances_have_a_nees_within_its_band() -> None:
    rng = np.random.default_rng(0)
    T = bend(2000)
    sigma = np.array([0.1, 0.2, 0.3, 0.01, 0.02, 0.03])
    e = rng.normal(size=(len(T), 6)) * sigma
    noisy = se3.transform(se3.exp_so3(e[:, 3:]) @ T[:, :3, :3], T[:, :3, 3] + e[:, :3])
    C = np.tile(np.diag(sigma**2), (len(T), 1, 1))
    nees = compare(track(noisy, C), track(T), align="none").results["nees"]
    low, high = nees["band_95"]
    assert low < nees["mean"] < high
    assert 0.93 < nees["inside_95"] < 0.97
    overconfident = compare(track(noisy, C / 4), track(T), align="none").results["nees"]
    assert overconfident["mean"] == pytest.approx(4 * nees["mean"])
    C[:1000] = np.nan
    assert compare(track(noisy, C), track(T), align="none").results["nees"]["unknown"] == 1000


@pytest.mark.parametrize("align", ["se3", "yaw", "origin"])
def test_the_nees_of_an_odometry_is_relative_to_its_start(align: Mode) -> None:
    # A path along x leaves the rotation about x free in a fit to its positions.
    rng = np.random.default_rng(1)
    n, sigma = 200, np.array([0.01, 0.01, 0.01, 1e-3, 1e-3, 1e-3])
    truth = se3.transform(np.eye(3), np.column_stack([0.1 * np.arange(n), 1e-3 * rng.normal(size=(n, 2))]))
    e = rng.normal(size=(n, 6)) * sigma
    e[0] = 0.0
    noisy = se3.transform(se3.exp_so3(e[:, 3:]) @ truth[:, :3, :3], truth[:, :3, 3] + e[:, :3])
    start = se3.exp_se3([4.0, 5.0, 6.0, 0.1, 0.2, 0.3])
    C = np.tile(np.diag(sigma**2), (n, 1, 1))
    nees = compare(track(start @ noisy, C), track(truth), align=align).results["nees"]
    low, high = nees["band_95"]
    assert nees["alignment"] == "origin"
    assert low < nees["mean"] < high


def test_covariances_rotate_with_the_alignment() -> None:
    T = bend()
    T_rotation = se3.exp_se3([0, 0, 0, 0, 0, np.pi / 2])
    C = np.tile(np.diag([0.01, 1.0, 0.5, 1e-4, 1e-2, 1e-3]), (len(T), 1, 1))
    comparison = compare(track(T_rotation @ T, C), track(T))
    np.testing.assert_allclose(
        np.diag(comparison.estimate.covariances[0]), [1.0, 0.01, 0.5, 1e-2, 1e-4, 1e-3], atol=1e-6
    )


def test_relative_errors_require_poses_at_that_distance() -> None:
    with pytest.raises(InputError, match="no two of 40 poses"):
        compare(track(bend(40)), track(bend(40)), delta=100.0, delta_unit="m")
    with pytest.raises(InputError, match="whole number"):
        compare(track(bend(40)), track(bend(40)), delta=1.5)


def test_a_track_with_equal_stamps_is_refused() -> None:
    with pytest.raises(InputError, match="pose 1 is not later"):
        Track("still", np.zeros(2, np.int64), np.tile(np.eye(4), (2, 1, 1)))


def test_table_and_plot_show_the_results() -> None:
    C = np.tile(np.eye(6), (200, 1, 1))
    comparison = compare(track(bend(), C), track(bend()))
    assert "ATE m" in table(comparison.results)
    assert "NEES of 200 poses" in table(comparison.results)
    svg = figure_bytes(draw(comparison), "svg").decode()
    texts = set(re.findall(r">([^<>]+)</text>", svg))
    assert {"reference", "estimate", "path length, m", "x", "y", "z", "distance"} <= texts
    assert any("aligned by rotation and translation" in text for text in texts)
    assert figure_bytes(draw(comparison), "svg").decode() == svg


def test_repeated_and_unordered_stamps_are_dropped_and_counted() -> None:
    stamps_ns = np.array([1, 2, 2, 5, 4, 6], np.int64) * 10**9
    T = np.tile(np.eye(4), (6, 1, 1))
    T[:, 0, 3] = np.arange(6)
    shuffled = Track.of_ascending("log", stamps_ns, T)
    assert shuffled.stamps_ns.tolist() == [10**9, 2 * 10**9, 4 * 10**9, 6 * 10**9]
    assert shuffled.positions_m[:, 0].tolist() == [0.0, 1.0, 4.0, 5.0]
    assert shuffled.dropped == 2
    results = compare(shuffled, shuffled, align="none").results
    assert "2 poses of the estimate are dropped" in table(results)
    assert results["ate"]["rmse_by_axis_m"] == {"x": 0.0, "y": 0.0, "z": 0.0}


def test_one_stamp_far_ahead_does_not_drop_the_poses_after_it() -> None:
    stamps_ns = np.arange(10, dtype=np.int64)
    stamps_ns[3] = 10**9
    track = Track.of_ascending("log", stamps_ns, np.tile(np.eye(4), (10, 1, 1)))
    assert track.stamps_ns.tolist() == [0, 1, 2, 4, 5, 6, 7, 8, 9]
    assert track.dropped == 1
