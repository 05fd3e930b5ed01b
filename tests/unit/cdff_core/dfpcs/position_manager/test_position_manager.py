# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The time line of a robot: exact where its sources are, never a jump, honest about who drives."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import ExtrapolationError, FrameNotFoundError, InputError, ProductNotFoundError
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.interfaces.profile import load_profile
from cdff_common.types import IMUSensors, Time, TransformWithCovariance
from cdff_core.dfpcs.position_manager.compound import PositionManager

MS = 1_000_000
T0 = 1_785_585_600_000_000_000
MARS_M_S2 = 3.71
SIGMA = np.square([0.02, 0.02, 0.02, 0.01, 0.01, 0.01])
T_SITE_ODOM = se3.transform(se3.exp_so3([0, 0, 0.7]), [3.0, -2.0, 0.5])
T_BASE_CAMERA = se3.exp_se3([0.3, 0.1, 0.9, -1.2, 1.2, -1.1])
T_BASE_IMU = se3.transform(se3.exp_so3([0.0, 0.0, np.pi / 2]), [0.1, 0.0, 0.0])
LEVEL = np.eye(3)
TILT = se3.exp_so3([0, 0.1, 0]) @ se3.exp_so3([0.05, 0, 0])


def frames(anchor_variances: np.ndarray = SIGMA) -> FrameGraph:
    graph = FrameGraph()
    graph.set_static("site", "mana/odom", UncertainTransform(T_SITE_ODOM, np.diag(anchor_variances)))
    graph.set_static("mana/base", "mana/navcam_left", UncertainTransform(T_BASE_CAMERA, np.zeros((6, 6))))
    graph.set_static("mana/base", "mana/imu", UncertainTransform(T_BASE_IMU, np.zeros((6, 6))))
    return graph


def manager(**config: object) -> PositionManager:
    made = PositionManager()
    made.configure(config, DfpcContext("mana", frames()))
    return made


def driven(t_s: float) -> tuple[float, float, float]:
    """Seconds at full speed, share of the full speed and its rate: at rest for a second, then a second's ramp."""
    u = t_s - 1.0
    if u <= 0.0:
        return 0.0, 0.0, 0.0
    return (0.5 * u * u, u, 1.0) if u < 1.0 else (u - 0.5, 1.0, 0.0)


def truth(t_s: float, tilt: np.ndarray = LEVEL) -> np.ndarray:
    """``T_odom_base``: a curve at 0.4 m/s, 0.1 rad/s, in the plane of the tilt."""
    return se3.transform(tilt, [0, 0, 0]) @ se3.exp_se3(driven(t_s)[0] * np.array([0.4, 0, 0, 0, 0, 0.1]))


def pose(
    port: str, t_s: float, T: np.ndarray, covariance: np.ndarray | None, parent: str, child: str, status: Status
) -> Sample:
    stamp_ns = T0 + round(t_s * 1000) * MS
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance), parent=parent, child=child, stamp_ns=stamp_ns
    )
    return Sample(port, stamp_ns, 0, value, f"{port}@{t_s:.3f}", quality=Quality(status))


def wheels(t_s: float, scale: float = 1.0) -> Sample:
    flat = truth(t_s)
    flat[:3, 3] *= scale
    return pose("odometry", t_s, flat, None, "mana/odom", "mana/base", Status.OK)


def visual(t_s: float, first_s: float = 0.0, status: Status = Status.OK, tilt: np.ndarray = LEVEL) -> Sample:
    T_first_camera = se3.inverse(truth(first_s, tilt) @ T_BASE_CAMERA) @ truth(t_s, tilt) @ T_BASE_CAMERA
    grown = 1e-6 * (1.0 + t_s) * np.eye(6)
    return pose("visual_odometry", t_s, T_first_camera, grown, "mana/vo", "mana/navcam_left", status)


def imu(t_s: float, tilt: np.ndarray = TILT) -> Sample:
    stamp_ns = T0 + round(t_s * 1000) * MS
    _, speed, growth = driven(t_s)
    rate, spin = np.array([0, 0, 0.1 * speed]), np.array([0, 0, 0.1 * growth])
    R, lever = T_BASE_IMU[:3, :3], T_BASE_IMU[:3, 3]
    push = np.array([0.4 * growth, 0.04 * speed**2, 0.0])
    push += np.cross(spin, lever) + np.cross(rate, np.cross(rate, lever))
    up = truth(t_s, tilt)[:3, :3].T @ [0, 0, MARS_M_S2]
    value = IMUSensors(Time.from_ns(stamp_ns), R.T @ (up + push), R.T @ rate, np.zeros(3))
    return Sample("imu", stamp_ns, 0, value)


def times(rate_hz: float, end_s: float, begin_s: float = 0.0) -> list[float]:
    return [k / rate_hz for k in range(round(begin_s * rate_hz), round(end_s * rate_hz) + 1)]


def feed(dfpc: PositionManager, samples: Iterable[Sample], in_order: bool = True) -> list[Output]:
    ordered = sorted(samples, key=lambda s: (s.stamp_ns, s.port)) if in_order else samples
    return [output for sample in ordered for output in dfpc.step(sample)]


def poses(outputs: Iterable[Output]) -> list[Output]:
    return [o for o in outputs if o.port == "pose"]


def error_m(output: Output, tilt: np.ndarray = LEVEL) -> float:
    expected = T_SITE_ODOM @ truth((output.t1_ns - T0) * 1e-9, tilt)
    return float(np.linalg.norm(output.value.transform.matrix - expected))


def test_visual_odometry_is_carried_into_the_site_through_mount_and_anchor_exactly() -> None:
    out = poses(feed(manager(), [visual(t) for t in times(5, 6)]))
    assert len(out) == len(times(5, 6))
    assert max(map(error_m, out)) < 1e-3
    assert {o.quality.status for o in out} == {Status.OK}
    assert (out[-1].frame, out[-1].child) == ("site", "mana/base")
    assert "source:vo" in out[-1].quality.reasons
    assert out[-1].inputs == ("visual_odometry@6.000",)


def test_the_start_is_levelled_by_gravity_through_the_imu_s_mount() -> None:
    samples = [visual(t, tilt=TILT) for t in times(5, 4)] + [imu(t) for t in times(100, 4)]
    out = poses(feed(manager(), samples))
    assert max(error_m(o, TILT) for o in out) < 2e-3
    assert "not_levelled" not in out[0].quality.reasons


def test_where_the_heading_is_known_a_wrong_tilt_turns_about_z_and_the_covariance_says_so() -> None:
    """Uphill by 25 degrees; the accelerometer's bias leans the start by 2 mrad to the side."""
    uphill = se3.exp_so3(np.radians([0.0, -25.0, 0.0]))
    bias = 2e-3 * MARS_M_S2 * np.array([0.0, 1.0, 0.0])

    def biased(t_s: float) -> Sample:
        sample = imu(t_s, uphill)
        force = sample.value.acc + T_BASE_IMU[:3, :3].T @ bias
        value = IMUSensors(sample.value.timestamp, force, sample.value.gyro, np.zeros(3))
        return Sample("imu", sample.stamp_ns, 0, value)

    made = PositionManager()
    made.configure({}, DfpcContext("mana", frames(np.zeros(6))))
    samples = [*(biased(t) for t in times(100, 0.8)), *(visual(t, tilt=uphill) for t in times(4, 0.8))]
    found = poses(feed(made, samples))[0].value.transform
    error = se3.log_so3(found.matrix[:3, :3] @ (T_SITE_ODOM @ truth(0.0, uphill))[:3, :3].T)
    heading = np.arctan2(T_SITE_ODOM[1, 0], T_SITE_ODOM[0, 0])
    ahead = np.array([np.cos(heading), np.sin(heading)])
    P = found.covariance[3:, 3:]
    assert abs(error[2]) == pytest.approx(np.tan(np.radians(25.0)) * 2e-3, rel=0.05)
    assert P[2, :2] @ ahead / (ahead @ P[:2, :2] @ ahead) == pytest.approx(error[2] / (error[:2] @ ahead), rel=0.1)


def test_a_start_without_imu_says_that_it_is_not_levelled_and_widens_the_tilt() -> None:
    out = poses(feed(manager(start_tilt_sigma_rad=0.06), [visual(t) for t in times(5, 2)]))
    assert "not_levelled" in out[0].quality.reasons
    assert out[0].value.transform.covariance[3, 3] == pytest.approx(0.06**2 + SIGMA[3], rel=0.01)


def test_wheels_alone_drive_degraded_and_turn_by_the_gyro() -> None:
    samples = [wheels(t) for t in times(10, 6)] + [imu(t, np.eye(3)) for t in times(100, 6)]
    out = poses(feed(manager(), samples))
    assert max(map(error_m, out)) < 1e-2
    assert {o.quality.status for o in out} == {Status.DEGRADED}
    assert all("source:wheels" in o.quality.reasons for o in out)


def test_wheels_follow_a_tilted_plane_when_levelled() -> None:
    samples = [wheels(t) for t in times(10, 6)] + [imu(t) for t in times(100, 6)]
    out = poses(feed(manager(), samples))
    assert max(error_m(o, TILT) for o in out) < 1e-2


def test_wheels_take_over_when_vision_falls_silent_and_give_back_without_a_jump() -> None:
    slip = 1.1
    samples = [wheels(t, slip) for t in times(10, 12)]
    samples += [visual(t) for t in times(5, 12) if not 4.0 < t < 8.0]
    out = poses(feed(manager(visual_timeout_s=0.5), samples))
    steps = [
        np.linalg.norm(b.value.transform.matrix[:3, 3] - a.value.transform.matrix[:3, 3]) / ((b.t1_ns - a.t1_ns) * 1e-9)
        for a, b in itertools.pairwise(out)
    ]
    assert max(steps) < 0.4 * slip + 0.01
    drivers = [o.quality.reasons[0] for o in out]
    assert drivers[0] == "source:start"
    at = {round((o.t1_ns - T0) * 1e-9, 1): o for o in out}
    assert at[3.0].quality.status is Status.OK
    assert at[6.0].quality.status is Status.DEGRADED
    assert at[11.0].quality.status is Status.OK
    # Most of what the wheels count too much between 4 s and 8 s was learnt from vision before.
    assert error_m(out[-1]) < 0.3 * (slip - 1) * 0.4 * 4.0


def test_visual_odometry_that_starts_late_attaches_at_its_first_pose() -> None:
    samples = [wheels(t) for t in times(10, 8)] + [visual(t, first_s=3.17) for t in [3.17, *times(5, 8, 3.4)]]
    samples += [imu(t, np.eye(3)) for t in times(100, 8)]
    out = poses(feed(manager(), samples))
    assert max(map(error_m, out)) < 5e-3
    assert out[-1].quality.status is Status.OK


def test_visual_poses_that_arrive_late_replace_what_wheels_said_meanwhile() -> None:
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


def test_a_visual_increment_the_wheels_contradict_is_not_taken() -> None:
    jump = se3.transform(np.eye(3), [0.0, 0.0, 3.0])
    samples: list[Sample] = [wheels(t) for t in times(10, 6)] + [imu(t, np.eye(3)) for t in times(100, 6)]
    for t in times(5, 6):
        v = visual(t)
        if t >= 3.0:
            v = pose(
                "visual_odometry", t, v.value.transform.matrix @ jump, None, "mana/vo", "mana/navcam_left", Status.OK
            )
        samples.append(v)
    out = poses(feed(manager(), samples))
    assert any("visual_odometry_refused" in o.quality.reasons for o in out)
    # From the jump on increments are those of a camera 3 m further ahead: only the lever differs, not the origin.
    assert max(error_m(o) for o in out if o.t1_ns <= T0 + 3000 * MS) < 5e-3


def test_degraded_vision_weighs_less_and_the_pose_says_so() -> None:
    def run(status: Status) -> Output:
        samples = [visual(t, status=status if t > 2.0 else Status.OK) for t in times(5, 4)]
        return poses(feed(manager(), samples))[-1]

    degraded, fine = run(Status.DEGRADED), run(Status.OK)
    assert error_m(degraded) < 5e-3
    assert degraded.quality.status is Status.DEGRADED
    assert "odometry_degraded" in degraded.quality.reasons
    sigma = [np.sqrt(np.trace(o.value.transform.covariance[:3, :3])) for o in (degraded, fine)]
    assert sigma[0] > sigma[1]


def test_failed_vision_is_not_used_and_not_missed_for_ever() -> None:
    failed = [
        Sample("visual_odometry", visual(t).stamp_ns, 0, None, quality=Quality(Status.FAILED)) for t in (3.0, 3.2)
    ]
    samples = [visual(t) for t in times(5, 6) if t not in (3.0, 3.2)] + failed
    samples += [wheels(t) for t in times(10, 6)] + [imu(t, np.eye(3)) for t in times(100, 6)]
    out = poses(feed(manager(), samples))
    assert max(map(error_m, out)) < 5e-3
    assert out[-1].quality.status is Status.OK


def test_covariance_grows_with_the_way_and_never_shrinks_by_a_handover() -> None:
    samples = [wheels(t) for t in times(10, 12)] + [visual(t) for t in times(5, 12) if not 4.0 < t < 8.0]
    out = poses(feed(manager(visual_timeout_s=0.5), samples))
    sigma = [np.sqrt(np.trace(o.value.transform.covariance[:3, :3])) for o in out]
    assert np.all(np.diff(sigma) > -1e-9)
    by_wheels = [s for s, o in zip(sigma, out, strict=True) if o.quality.reasons[0] == "source:wheels"]
    assert by_wheels[-1] - by_wheels[0] > 5 * (sigma[5] - sigma[0])


@pytest.mark.req("CDFF-CORE-074")
def test_poses_between_estimates_are_interpolated_and_any_two_frames_are_joined() -> None:
    dfpc = manager()
    feed(dfpc, [visual(t) for t in times(5, 4)])
    t_ns = T0 + 2_500 * MS
    between = dfpc.get_pose("site", "mana/base", t_ns)
    np.testing.assert_allclose(between.transform.matrix, T_SITE_ODOM @ truth(2.5), atol=2e-3)
    camera = dfpc.get_pose("site", "mana/navcam_left", t_ns).transform.matrix
    np.testing.assert_allclose(camera, between.transform.matrix @ T_BASE_CAMERA, atol=1e-12)
    back = dfpc.get_pose("mana/navcam_left", "site", t_ns).transform.matrix
    np.testing.assert_allclose(back @ camera, np.eye(4), atol=1e-12)


def test_a_time_far_beyond_the_time_line_is_refused_and_one_within_the_limit_predicted() -> None:
    dfpc = manager(extrapolation_s=0.2)
    feed(dfpc, [visual(t) for t in times(5, 3)])
    ahead = dfpc.get_pose("site", "mana/base", T0 + 3_150 * MS).transform
    np.testing.assert_allclose(ahead.matrix, T_SITE_ODOM @ truth(3.15), atol=0.02)
    newest = dfpc.get_pose("site", "mana/base", -1).transform
    assert np.trace(ahead.covariance) > np.trace(newest.covariance)
    with pytest.raises(ExtrapolationError, match="outside"):
        dfpc.get_pose("site", "mana/base", T0 + 3_300 * MS)
    with pytest.raises(ExtrapolationError):
        dfpc.get_pose("site", "mana/base", T0 - 500 * MS)
    with pytest.raises(FrameNotFoundError, match="mana/arm"):
        dfpc.get_pose("site", "mana/arm", T0)


def test_nothing_is_known_before_the_first_sample() -> None:
    dfpc = manager()
    with pytest.raises(ExtrapolationError):
        dfpc.get_pose("site", "mana/base", -1)
    with pytest.raises(ProductNotFoundError):
        dfpc.store.get("trajectory")
    assert list(dfpc.finish()) == []


def test_operations_take_their_parameters_as_text() -> None:
    dfpc = manager()
    feed(dfpc, [visual(t) for t in times(5, 3)])
    asked = dfpc.call("get_pose", {"parent": "site", "child": "mana/base", "t_ns": str(T0 + 2_000 * MS)})
    np.testing.assert_allclose(asked.transform.matrix, T_SITE_ODOM @ truth(2.0), atol=1e-3)
    part = dfpc.call("get_trajectory", {"t0_ns": str(T0 + 1_000 * MS), "t1_ns": str(T0 + 2_000 * MS)})
    assert list(part.stamps_ns) == [T0 + k * 200 * MS for k in range(5, 11)]
    with pytest.raises(InputError, match="parent"):
        dfpc.call("get_pose", {"child": "mana/base"})


def test_the_trajectory_comes_every_few_seconds_and_at_the_end() -> None:
    dfpc = manager(trajectory_period_s=2.0)
    out = feed(dfpc, [visual(t) for t in times(5, 7)])
    (last,) = dfpc.finish()
    assert [o.port for o in out].count("trajectory") == 3
    assert (last.port, last.t0_ns, last.t1_ns) == ("trajectory", T0, T0 + 7_000 * MS)
    np.testing.assert_allclose(last.value.matrices[-1], T_SITE_ODOM @ truth(7.0), atol=1e-3)
    assert dfpc.store.get("trajectory").stamps_ns.shape == last.value.stamps_ns.shape


def test_a_trajectory_is_published_again_when_it_has_grown_so_that_the_disk_does_not_fill_with_copies() -> None:
    dfpc = manager(trajectory_period_s=0.2, trajectory_share=0.25)
    published = [o for o in feed(dfpc, [visual(t) for t in times(5, 30)]) if o.port == "trajectory"]
    poses_kept = len(dfpc.get_trajectory(-1, -1).stamps_ns)
    assert sum(len(o.value.stamps_ns) for o in published) < poses_kept / 0.25 + poses_kept
    for before, after in itertools.pairwise(o.t1_ns - T0 for o in published):
        assert after <= 1.34 * before + 400 * MS


@pytest.mark.parametrize(
    "path", sorted((Path(__file__).parents[5] / "deploy" / "profiles").glob("*.yaml")), ids=lambda p: p.stem
)
def test_a_shipped_profile_lets_old_trajectories_go(path: Path) -> None:
    profile = load_profile(path)
    if any(entry.name == "position_manager" for robot in profile.robots for entry in robot.dfpcs):
        assert any(rule.product == "trajectory" and rule.max_count for rule in profile.retention)


def test_a_start_in_the_middle_of_a_drive_takes_its_place_from_the_wheels() -> None:
    samples = [wheels(t) for t in times(10, 8, 5.0)] + [imu(t, np.eye(3)) for t in times(100, 8, 5.0)]
    out = poses(feed(manager(), samples))
    assert max(map(error_m, out)) < 5e-3


def test_wheels_whose_count_was_reset_do_not_throw_the_robot_back() -> None:
    restarted = [wheels(t) for t in times(10, 4)]
    origin = se3.inverse(truth(4.0))
    restarted += [
        pose(
            "odometry",
            t,
            se3.transform(np.eye(3), [-50, 0, 0]) @ origin @ truth(t),
            None,
            "mana/odom",
            "mana/base",
            Status.OK,
        )
        for t in times(10, 6, 4.1)
    ]
    out = poses(feed(manager(), restarted))
    assert error_m(out[-1]) < 0.1


def test_two_runs_give_the_same_poses_and_a_reset_forgets() -> None:
    samples = [wheels(t) for t in times(10, 6)] + [visual(t) for t in times(3, 6)] + [imu(t) for t in times(100, 6)]
    dfpc = manager()
    first = [o.value.transform.matrix for o in poses(feed(dfpc, samples))]
    dfpc.reset()
    second = [o.value.transform.matrix for o in poses(feed(dfpc, samples))]
    np.testing.assert_array_equal(first, second)
