# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Position manager: accurate poses without jumps, with their source in the quality."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import ExtrapolationError, FrameNotFoundError, InputError, ProductNotFoundError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.interfaces.profile import load_profile
from cdff_common.types import IMUSensors
from cdff_core.dfpcs.position_manager.compound import PositionManager
from tests.support.position_manager_samples import (
    MARS_GRAVITY_M_S2,
    MS,
    T0,
    T_BASE_CAMERA,
    T_BASE_IMU,
    T_SITE_ODOM,
    TILTED_ROTATION,
    VARIANCES,
    error_m,
    feed,
    frames,
    imu,
    manager,
    pose,
    poses,
    times,
    true_pose,
    visual,
    wheels,
)


def test_visual_odometry_is_transformed_into_the_site_by_mount_and_anchor() -> None:
    out = poses(feed(manager(), [visual(t) for t in times(5, 6)]))
    assert len(out) == len(times(5, 6))
    assert max(map(error_m, out)) < 1e-3
    assert {o.quality.status for o in out} == {Status.OK}
    assert (out[-1].frame, out[-1].child) == ("site", "mana/base")
    assert "source:vo" in out[-1].quality.reasons
    assert out[-1].inputs == ("visual_odometry@6.000",)


def test_the_start_is_levelled_by_gravity_measured_by_a_mounted_imu() -> None:
    samples = [visual(t, tilt=TILTED_ROTATION) for t in times(5, 4)] + [imu(t) for t in times(100, 4)]
    out = poses(feed(manager(), samples))
    assert max(error_m(o, TILTED_ROTATION) for o in out) < 2e-3
    assert "not_levelled" not in out[0].quality.reasons


def test_a_wrong_tilt_at_a_known_heading_rotates_about_z_and_the_covariance_contains_it() -> None:
    """Start on a slope of 25 degrees with an accelerometer bias that causes a roll error of 2 mrad."""
    uphill = se3.exp_so3(np.radians([0.0, -25.0, 0.0]))
    bias = 2e-3 * MARS_GRAVITY_M_S2 * np.array([0.0, 1.0, 0.0])

    def biased(t_s: float) -> Sample:
        sample = imu(t_s, uphill)
        force = sample.value.acc + T_BASE_IMU[:3, :3].T @ bias
        value = IMUSensors(sample.value.timestamp, force, sample.value.gyro, np.zeros(3))
        return Sample("imu", sample.stamp_ns, 0, value)

    dfpc = PositionManager()
    dfpc.configure({}, DfpcContext("mana", frames(np.zeros(6))))
    samples = [*(biased(t) for t in times(100, 0.8)), *(visual(t, tilt=uphill) for t in times(4, 0.8))]
    result = poses(feed(dfpc, samples))[0].value.transform
    error = se3.log_so3(result.matrix[:3, :3] @ (T_SITE_ODOM @ true_pose(0.0, uphill))[:3, :3].T)
    heading = np.arctan2(T_SITE_ODOM[1, 0], T_SITE_ODOM[0, 0])
    forward = np.array([np.cos(heading), np.sin(heading)])
    P = result.covariance[3:, 3:]
    assert abs(error[2]) == pytest.approx(np.tan(np.radians(25.0)) * 2e-3, rel=0.05)
    assert P[2, :2] @ forward / (forward @ P[:2, :2] @ forward) == pytest.approx(
        error[2] / (error[:2] @ forward), rel=0.1
    )


def test_a_start_without_imu_is_reported_as_not_levelled_with_a_large_tilt_covariance() -> None:
    out = poses(feed(manager(start={"tilt_sigma_rad": 0.06}), [visual(t) for t in times(5, 2)]))
    assert "not_levelled" in out[0].quality.reasons
    assert out[0].value.transform.covariance[3, 3] == pytest.approx(0.06**2 + VARIANCES[3], rel=0.01)


def test_wheels_and_imu_alone_yield_degraded_poses() -> None:
    samples = [wheels(t) for t in times(10, 6)] + [imu(t, np.eye(3)) for t in times(100, 6)]
    out = poses(feed(manager(), samples))
    assert max(map(error_m, out)) < 1e-2
    assert {o.quality.status for o in out} == {Status.DEGRADED}
    assert all("source:wheels" in o.quality.reasons for o in out)


def test_with_a_levelled_start_the_wheels_follow_a_tilted_plane() -> None:
    samples = [wheels(t) for t in times(10, 6)] + [imu(t) for t in times(100, 6)]
    out = poses(feed(manager(), samples))
    assert max(error_m(o, TILTED_ROTATION) for o in out) < 1e-2


def test_wheels_replace_missing_visual_odometry_without_a_jump() -> None:
    slip = 1.1
    samples = [wheels(t, slip) for t in times(10, 12)]
    samples += [visual(t) for t in times(5, 12) if not 4.0 < t < 8.0]
    out = poses(feed(manager(odometry={"timeout_s": 0.5}), samples))
    steps = [
        np.linalg.norm(b.value.transform.matrix[:3, 3] - a.value.transform.matrix[:3, 3])
        / ((b.t1_ns - a.t1_ns) * 1e-9)
        for a, b in itertools.pairwise(out)
    ]
    assert max(steps) < 0.4 * slip + 0.01
    first_reasons = [o.quality.reasons[0] for o in out]
    assert first_reasons[0] == "source:start"
    output_at = {round((o.t1_ns - T0) * 1e-9, 1): o for o in out}
    assert output_at[3.0].quality.status is Status.OK
    assert output_at[6.0].quality.status is Status.DEGRADED
    assert output_at[11.0].quality.status is Status.OK
    # The wheel slip was estimated from vision before 4 s, so most of it is corrected between 4 s and 8 s.
    assert error_m(out[-1]) < 0.3 * (slip - 1) * 0.4 * 4.0


def test_visual_odometry_that_starts_late_continues_from_the_estimated_pose() -> None:
    samples = [wheels(t) for t in times(10, 8)] + [visual(t, first_s=3.17) for t in [3.17, *times(5, 8, 3.4)]]
    samples += [imu(t, np.eye(3)) for t in times(100, 8)]
    out = poses(feed(manager(), samples))
    assert max(map(error_m, out)) < 5e-3
    assert out[-1].quality.status is Status.OK


def test_late_visual_poses_correct_the_poses_by_wheels() -> None:
    slip, delay_s = 1.3, 0.4
    samples = [(t, wheels(t, slip)) for t in times(10, 6)] + [(t + delay_s, visual(t)) for t in times(5, 6)]
    ordered = [s for _, s in sorted(samples, key=lambda p: (p[0], p[1].port))]
    dfpc = manager()
    out = poses(feed(dfpc, ordered, in_order=False))
    assert max(map(error_m, out)) < 5e-3
    stamps = [o.t1_ns for o in out]
    assert stamps == sorted(set(stamps))
    newest = dfpc.get_pose("site", "mana/base", -1)
    assert newest.stamp_ns == T0 + 6000 * MS


def test_a_visual_increment_that_contradicts_the_wheels_is_refused() -> None:
    jump = se3.transform(np.eye(3), [0.0, 0.0, 3.0])
    samples: list[Sample] = [wheels(t) for t in times(10, 6)] + [imu(t, np.eye(3)) for t in times(100, 6)]
    for t in times(5, 6):
        sample = visual(t)
        if t >= 3.0:
            sample = pose(
                "visual_odometry",
                t,
                sample.value.transform.matrix @ jump,
                None,
                "mana/vo",
                "mana/navcam_left",
                Status.OK,
            )
        samples.append(sample)
    out = poses(feed(manager(), samples))
    assert any("visual_odometry_refused" in o.quality.reasons for o in out)
    # After the jump, the increments are those of a camera 3 m further ahead.
    assert max(error_m(o) for o in out if o.t1_ns <= T0 + 3000 * MS) < 5e-3


def test_degraded_visual_odometry_has_a_lower_weight_and_is_reported() -> None:
    def run(status: Status) -> Output:
        samples = [visual(t, status=status if t > 2.0 else Status.OK) for t in times(5, 4)]
        return poses(feed(manager(), samples))[-1]

    degraded, ok = run(Status.DEGRADED), run(Status.OK)
    assert error_m(degraded) < 5e-3
    assert degraded.quality.status is Status.DEGRADED
    assert "odometry_degraded" in degraded.quality.reasons
    sigma = [np.sqrt(np.trace(o.value.transform.covariance[:3, :3])) for o in (degraded, ok)]
    assert sigma[0] > sigma[1]


def test_failed_visual_odometry_is_skipped_until_it_recovers() -> None:
    failed = [
        Sample("visual_odometry", visual(t).stamp_ns, 0, None, quality=Quality(Status.FAILED))
        for t in (3.0, 3.2)
    ]
    samples = [visual(t) for t in times(5, 6) if t not in (3.0, 3.2)] + failed
    samples += [wheels(t) for t in times(10, 6)] + [imu(t, np.eye(3)) for t in times(100, 6)]
    out = poses(feed(manager(), samples))
    assert max(map(error_m, out)) < 5e-3
    assert out[-1].quality.status is Status.OK


def test_failed_wheel_odometry_before_the_start_is_ignored() -> None:
    failed = Sample("odometry", wheels(0.0).stamp_ns, 0, None, quality=Quality(Status.FAILED))
    samples = [failed] + [wheels(t) for t in times(10, 4, 0.1)] + [imu(t, np.eye(3)) for t in times(100, 4)]
    out = poses(feed(manager(), samples))
    assert max(map(error_m, out)) < 5e-3


def test_covariance_grows_with_path_length_and_hardly_shrinks_at_a_change_of_source() -> None:
    samples = [wheels(t) for t in times(10, 12)] + [visual(t) for t in times(5, 12) if not 4.0 < t < 8.0]
    out = poses(feed(manager(odometry={"timeout_s": 0.5}), samples))
    sigma = [np.sqrt(np.trace(o.value.transform.covariance[:3, :3])) for o in out]
    # Vision after the gap measures the slip, which is correlated with that in the gap: a twentieth at most.
    assert np.all(np.diff(sigma) > -0.05 * np.array(sigma[1:]))
    by_wheels = [s for s, o in zip(sigma, out, strict=True) if o.quality.reasons[0] == "source:wheels"]
    assert by_wheels[-1] - by_wheels[0] > 5 * (sigma[5] - sigma[0])


@pytest.mark.req("CDFF-CORE-074")
def test_poses_between_estimates_are_interpolated_for_any_two_frames() -> None:
    dfpc = manager()
    feed(dfpc, [visual(t) for t in times(5, 4)])
    t_ns = T0 + 2_500 * MS
    between = dfpc.get_pose("site", "mana/base", t_ns)
    np.testing.assert_allclose(between.transform.matrix, T_SITE_ODOM @ true_pose(2.5), atol=2e-3)
    camera = dfpc.get_pose("site", "mana/navcam_left", t_ns).transform.matrix
    np.testing.assert_allclose(camera, between.transform.matrix @ T_BASE_CAMERA, atol=1e-12)
    inverse = dfpc.get_pose("mana/navcam_left", "site", t_ns).transform.matrix
    np.testing.assert_allclose(inverse @ camera, np.eye(4), atol=1e-12)


def test_a_time_beyond_the_timeline_is_predicted_up_to_the_limit() -> None:
    dfpc = manager(timeline={"extrapolation_s": 0.2})
    feed(dfpc, [visual(t) for t in times(5, 3)])
    predicted = dfpc.get_pose("site", "mana/base", T0 + 3_150 * MS).transform
    np.testing.assert_allclose(predicted.matrix, T_SITE_ODOM @ true_pose(3.15), atol=0.02)
    newest = dfpc.get_pose("site", "mana/base", -1).transform
    assert np.trace(predicted.covariance) > np.trace(newest.covariance)
    with pytest.raises(ExtrapolationError, match="outside"):
        dfpc.get_pose("site", "mana/base", T0 + 3_300 * MS)
    with pytest.raises(ExtrapolationError):
        dfpc.get_pose("site", "mana/base", T0 - 500 * MS)
    with pytest.raises(FrameNotFoundError, match="mana/arm"):
        dfpc.get_pose("site", "mana/arm", T0)


def test_queries_before_the_first_sample_are_refused() -> None:
    dfpc = manager()
    with pytest.raises(ExtrapolationError):
        dfpc.get_pose("site", "mana/base", -1)
    with pytest.raises(ProductNotFoundError):
        dfpc.store.get("trajectory")
    assert list(dfpc.finish()) == []


def test_operations_accept_parameters_as_text() -> None:
    dfpc = manager()
    feed(dfpc, [visual(t) for t in times(5, 3)])
    pose = dfpc.call("get_pose", {"parent": "site", "child": "mana/base", "t_ns": str(T0 + 2_000 * MS)})
    np.testing.assert_allclose(pose.transform.matrix, T_SITE_ODOM @ true_pose(2.0), atol=1e-3)
    section = dfpc.call("get_trajectory", {"t0_ns": str(T0 + 1_000 * MS), "t1_ns": str(T0 + 2_000 * MS)})
    assert list(section.stamps_ns) == [T0 + k * 200 * MS for k in range(5, 11)]
    with pytest.raises(InputError, match="parent"):
        dfpc.call("get_pose", {"child": "mana/base"})


def test_the_trajectory_is_published_periodically_and_at_the_end() -> None:
    dfpc = manager(publication={"trajectory_period_s": 2.0})
    out = feed(dfpc, [visual(t) for t in times(5, 7)])
    (last,) = dfpc.finish()
    assert [o.port for o in out].count("trajectory") == 3
    assert (last.port, last.t0_ns, last.t1_ns) == ("trajectory", T0, T0 + 7_000 * MS)
    np.testing.assert_allclose(last.value.matrices[-1], T_SITE_ODOM @ true_pose(7.0), atol=1e-3)
    assert dfpc.store.get("trajectory").stamps_ns.shape == last.value.stamps_ns.shape


def test_a_trajectory_is_published_again_when_it_has_grown_by_a_fraction() -> None:
    dfpc = manager(publication={"trajectory_period_s": 0.2, "trajectory_growth": 0.25})
    published = [o for o in feed(dfpc, [visual(t) for t in times(5, 30)]) if o.port == "trajectory"]
    pose_count = len(dfpc.get_trajectory(-1, -1).stamps_ns)
    assert sum(len(o.value.stamps_ns) for o in published) < pose_count / 0.25 + pose_count
    for previous_ns, current_ns in itertools.pairwise(o.t1_ns - T0 for o in published):
        assert current_ns <= 1.34 * previous_ns + 400 * MS


@pytest.mark.parametrize(
    "path", sorted((Path(__file__).parents[5] / "deploy" / "profiles").glob("*.yaml")), ids=lambda p: p.stem
)
def test_a_shipped_profile_limits_the_number_of_trajectories(path: Path) -> None:
    profile = load_profile(path)
    if any(entry.name == "position_manager" for robot in profile.robots for entry in robot.dfpcs):
        assert any(rule.product == "trajectory" and rule.max_count for rule in profile.retention)


def test_a_start_in_motion_has_the_position_of_the_wheel_odometry() -> None:
    samples = [wheels(t) for t in times(10, 8, 5.0)] + [imu(t, np.eye(3)) for t in times(100, 8, 5.0)]
    out = poses(feed(manager(), samples))
    assert max(map(error_m, out)) < 5e-3


def test_a_reset_of_the_wheels_origin_does_not_move_the_robot() -> None:
    restarted = [wheels(t) for t in times(10, 4)]
    origin = se3.inverse(true_pose(4.0))
    restarted += [
        pose(
            "odometry",
            t,
            se3.transform(np.eye(3), [-50, 0, 0]) @ origin @ true_pose(t),
            None,
            "mana/odom",
            "mana/base",
            Status.OK,
        )
        for t in times(10, 6, 4.1)
    ]
    out = poses(feed(manager(), restarted))
    assert error_m(out[-1]) < 0.1


def test_two_runs_give_the_same_poses_and_a_reset_clears_the_state() -> None:
    samples = (
        [wheels(t) for t in times(10, 6)] + [visual(t) for t in times(3, 6)] + [imu(t) for t in times(100, 6)]
    )
    dfpc = manager()
    first = [o.value.transform.matrix for o in poses(feed(dfpc, samples))]
    dfpc.reset()
    second = [o.value.transform.matrix for o in poses(feed(dfpc, samples))]
    np.testing.assert_array_equal(first, second)
