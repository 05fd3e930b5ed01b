# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Position manager: fixes, lidar odometry, joints, late measurements, relative poses, pins and restarts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.codecs import decode, encode
from cdff_common.errors import ExtrapolationError, InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.product import Status
from cdff_common.types import Joints, JointState, Time
from cdff_core.dfpcs.position_manager.compound import PositionManager
from tests.support.position_manager_samples import (
    LEVEL_ROTATION,
    MS,
    T0,
    URDF,
    error_m,
    feed,
    fix,
    frames,
    imu,
    manager,
    poses,
    times,
    true_pose,
    visual,
    wheels_and_imu,
)


def test_fixes_correct_the_drift_of_the_wheels() -> None:
    slipping = wheels_and_imu(8, 1.3)
    drifting = poses(feed(manager(), slipping))[-1]
    out = poses(
        feed(
            manager(fixes={"weighting": "kalman"}),
            [*slipping, *[fix(t, np.zeros(3)) for t in (4.0, 6.0, 8.0)]],
        )
    )
    assert out[-1].quality.reasons[0] == "source:fix"
    assert error_m(out[-1]) < 0.5 * error_m(drifting)
    assert out[-1].quality.status is Status.OK


def test_independent_fixes_are_averaged_but_fixes_with_common_errors_are_not() -> None:
    fixes = [fix(t, np.zeros(3)) for t in times(2, 8, 2.0)]
    sigma = {}
    for weighting in ("intersection", "kalman"):
        last = poses(feed(manager(fixes={"weighting": weighting}), wheels_and_imu(8) + fixes))[-1]
        sigma[weighting] = np.sqrt(np.trace(last.value.transform.covariance[:3, :3]))
    assert sigma["intersection"] > 0.03
    assert sigma["kalman"] < 0.8 * sigma["intersection"]


def test_a_contradicting_fix_is_refused_and_counted() -> None:
    samples = [*wheels_and_imu(6), *[visual(t) for t in times(5, 6)], fix(5.05, np.array([9.0, 0, 0]))]
    out = poses(feed(manager(), samples))
    assert error_m(out[-1]) < 0.01
    assert out[-1].quality.metrics["refused_fix"] == 1.0
    assert any("fix_refused" in o.quality.reasons for o in out)


def test_fixes_in_a_frame_that_the_first_fix_defines_limit_the_drift() -> None:
    map_fixes = [fix(t, np.zeros(3), 0.01, "mana/slam") for t in times(2, 8, 1.0)]
    drifting, corrected = (
        poses(feed(manager(fixes={"weighting": "kalman"}), wheels_and_imu(8, 1.3) + more))[-1]
        for more in ([], map_fixes)
    )
    assert error_m(corrected) < 0.25 * error_m(drifting)


def test_an_absolute_fix_is_fused_with_poses_in_a_map_and_poses_are_published_between_its_samples() -> None:
    first_in_map = fix(2.0, np.zeros(3), 0.01, "mana/slam")
    in_map = [first_in_map, *[fix(t, np.array([0.5, 0, 0]), 0.2, "mana/slam") for t in times(2, 8, 2.5)]]
    absolute = [replace(fix(t, np.zeros(3), 0.02), port="absolute_fix") for t in (4.0, 8.0)]
    drifting, corrected = (
        poses(feed(manager(), wheels_and_imu(8) + in_map + more))[-1] for more in ([], absolute)
    )
    assert error_m(corrected) < 0.5 * error_m(drifting)
    assert "refused_absolute_fix" not in corrected.quality.metrics
    out = poses(feed(manager(), wheels_and_imu(8, 1.3) + absolute[:1]))
    after_the_fix = [o for o in out if T0 + 4_000 * MS <= o.t1_ns < T0 + 5_000 * MS]
    assert len(after_the_fix) > 8


def test_lidar_odometry_is_used_without_vision() -> None:
    lidar = [replace(visual(t), port="lidar_odometry") for t in times(5, 6)]
    out = poses(feed(manager(), wheels_and_imu(6, 1.2) + lidar))
    assert out[-1].quality.reasons[0] == "source:lidar"
    assert error_m(out[-1]) < 0.01


CORRELATED = {
    "odometry": {"correlated": ["visual_odometry", "lidar_odometry"], "lidar_scale": 1.0},
    "lidar_increment": {"floor_m": 0.00005, "floor_rad": 0.00001},
}


def visual_and_lidar(start_s: float = 0.0, end_s: float = 6.0) -> list[Sample]:
    """Return visual odometry; from ``start_s`` on, the same poses also as lidar odometry."""
    return [visual(t) for t in times(5, end_s)] + [
        replace(visual(t), port="lidar_odometry") for t in times(5, end_s, start_s)
    ]


@pytest.mark.parametrize("start_s", [0.0, 3.0])
def test_a_source_used_twice_adds_no_information_if_declared_correlated(
    start_s: float,
) -> None:
    def covariance_of(samples: list[Sample], **config: object) -> np.ndarray:
        return np.asarray(poses(feed(manager(**config), samples))[-1].value.transform.covariance)

    alone = covariance_of([visual(t) for t in times(5, 6)])
    both = covariance_of(visual_and_lidar(start_s), **CORRELATED)
    assert np.linalg.eigvalsh(both - alone)[0] > -0.005 * np.trace(alone)
    as_if_independent = covariance_of(
        visual_and_lidar(start_s), **{**CORRELATED, "odometry": {"lidar_scale": 1.0}}
    )
    assert np.trace(as_if_independent[:3, :3]) < np.trace(alone[:3, :3])


def test_the_order_of_arrival_of_correlated_odometries_has_no_effect() -> None:
    def late(port: str) -> list[Sample]:
        samples = wheels_and_imu(3) + visual_and_lidar(end_s=3.0)
        return sorted(samples, key=lambda s: (s.stamp_ns + (700 * MS if s.port == port else 0), s.port))

    results = []
    for port in ("", "visual_odometry", "lidar_odometry"):
        dfpc = manager(**CORRELATED)
        feed(dfpc, late(port), in_order=False)
        results.append(dfpc.get_pose("site", "mana/base", T0 + 3_000 * MS).transform)
    for result in results[1:]:
        np.testing.assert_allclose(result.matrix, results[0].matrix, atol=1e-9)
        np.testing.assert_allclose(result.covariance, results[0].covariance, rtol=1e-6, atol=1e-12)


def test_measurements_in_any_order_end_in_the_same_estimate(rng: np.random.Generator) -> None:
    samples = wheels_and_imu(6, 1.1) + [visual(t) for t in times(5, 6)] + [fix(4.0, np.zeros(3))]
    ordered = manager()
    feed(ordered, samples)
    shuffled = manager()
    late = sorted(
        samples, key=lambda s: (s.stamp_ns + (0 if s.port == "imu" else rng.integers(0, 900) * MS), s.port)
    )
    feed(shuffled, late, in_order=False)
    for dfpc in (ordered, shuffled):
        dfpc.finish()
    a, b = (d.get_pose("site", "mana/base", T0 + 6_000 * MS).transform for d in (ordered, shuffled))
    np.testing.assert_allclose(a.matrix, b.matrix, atol=2e-4)
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=0.05, atol=2e-6)


def test_a_measurement_later_than_the_memory_is_refused() -> None:
    dfpc = manager(timeline={"memory_s": 2.0})
    feed(dfpc, wheels_and_imu(12))
    before = dfpc.get_pose("site", "mana/base", -1).transform.matrix
    feed(dfpc, [fix(3.0, np.array([0.1, 0, 0]))])
    np.testing.assert_array_equal(dfpc.get_pose("site", "mana/base", -1).transform.matrix, before)


def test_a_motion_between_two_times_has_the_error_of_the_motion_alone() -> None:
    dfpc = manager()
    feed(dfpc, wheels_and_imu(10) + [visual(t) for t in times(5, 10)])
    a, b = T0 + 8_030 * MS, T0 + 9_010 * MS
    motion = dfpc.call(
        "get_transform",
        {"parent": "mana/base", "parent_t_ns": str(a), "child": "mana/base", "child_t_ns": str(b)},
    )
    np.testing.assert_allclose(
        motion.transform.matrix, se3.inverse(true_pose(8.03)) @ true_pose(9.01), atol=3e-3
    )
    alone = np.trace(motion.transform.covariance[:3, :3])
    absolute = np.trace(dfpc.get_pose("site", "mana/base", b).transform.covariance[:3, :3])
    assert alone < 0.1 * absolute
    inverse = dfpc.get_transform("mana/base", b, "mana/base", a).transform
    np.testing.assert_allclose(inverse.matrix @ motion.transform.matrix, np.eye(4), atol=1e-9)
    camera = dfpc.get_transform("site", a, "mana/navcam_left", b).transform
    np.testing.assert_allclose(camera.matrix, dfpc.get_pose("site", "mana/navcam_left", b).transform.matrix)
    # The odometry frame does not contain the error of the anchor.
    of_odom = dfpc.get_pose("mana/odom", "mana/base", b).transform
    np.testing.assert_allclose(of_odom.matrix, true_pose(9.01), atol=0.01)
    assert np.trace(of_odom.covariance[:3, :3]) < absolute


def test_joints_move_the_frames_of_the_urdf() -> None:
    dfpc = PositionManager()
    dfpc.configure({}, DfpcContext("mana", frames(), urdf=URDF))
    for t_s, angle in ((1.0, 0.0), (2.0, 0.5)):
        stamp_ns = T0 + round(t_s * 1000) * MS
        value = Joints(Time.from_ns(stamp_ns), ("pan",), (JointState(position=angle),))
        assert list(dfpc.step(Sample("joints", stamp_ns, 0, value))) == []
    head = dfpc.get_pose("mana/base", "mana/head", T0 + 1_500 * MS).transform.matrix
    np.testing.assert_allclose(head, se3.transform(se3.exp_so3([0, 0, 0.25]), [0, 0, 1]), atol=1e-9)
    with pytest.raises(InputError, match="elbow"):
        list(dfpc.step(Sample("joints", T0, 0, Joints(Time.from_ns(T0), ("elbow",), (JointState(),)))))
    with pytest.raises(InputError, match="expected -1 to 1"):
        list(
            dfpc.step(
                Sample("joints", T0, 0, Joints(Time.from_ns(T0), ("pan",), (JointState(position=2.0),)))
            )
        )


def test_old_estimates_are_thinned_then_removed_but_pinned_ones_are_kept() -> None:
    dfpc = manager(
        timeline={"memory_s": 1.0, "dense_s": 2.0, "thin_s": 1.0, "history_s": 6.0},
        publication={"trajectory_period_s": 1.0},
    )
    feed(dfpc, [visual(t) for t in times(5, 4)])
    pinned = dfpc.call("pin", {"t_ns": str(T0 + 3_100 * MS)}).transform.matrix
    feed(dfpc, [visual(t) for t in times(5, 20, 4.2)])
    stamps = dfpc.get_trajectory(-1, -1).stamps_ns
    assert np.sum(stamps < T0 + 13_000 * MS) < 8
    assert np.diff(stamps[stamps > T0 + 15_000 * MS]).max() <= 1_000 * MS
    np.testing.assert_allclose(dfpc.get_pose("site", "mana/base", T0 + 3_100 * MS).transform.matrix, pinned)
    np.testing.assert_array_equal(dfpc.store.get("pins").stamps_ns, [T0 + 3_100 * MS])
    with pytest.raises(ExtrapolationError, match="removed"):
        dfpc.get_pose("site", "mana/base", T0 + 8_000 * MS)
    dfpc.unpin(T0 + 3_100 * MS)
    with pytest.raises(ProductNotFoundError, match="not pinned"):
        dfpc.unpin(T0 + 3_100 * MS)


@pytest.mark.req("CDFF-CORE-077")
def test_a_restart_continues_and_wheels_bridge_the_time_in_between() -> None:
    stopped = manager()
    feed(stopped, [*wheels_and_imu(5, 1.05), *[visual(t) for t in times(5, 5)]])
    stopped.pin(T0 + 2_000 * MS)
    state = decode("PositionState", encode(stopped.state(), "uper"), "uper")
    restarted = manager()
    restarted.resume(state)
    motions = [
        d.get_transform("mana/base", T0 + 2_000 * MS, "mana/base", T0 + 4_000 * MS).transform
        for d in (stopped, restarted)
    ]
    np.testing.assert_allclose(motions[0].matrix, motions[1].matrix, atol=1e-9)
    np.testing.assert_allclose(motions[0].covariance, motions[1].covariance, atol=1e-12)
    np.testing.assert_array_equal(restarted.get_pins().stamps_ns, [T0 + 2_000 * MS])
    after_gap = [s for s in wheels_and_imu(12, 1.05) if s.stamp_ns > T0 + 8_000 * MS]
    out = poses(feed(restarted, after_gap))
    assert error_m(out[-1]) < 0.25
    assert "resumed" in out[-1].quality.reasons
    with pytest.raises(InputError, match="PositionState"):
        restarted.resume(Joints())


def test_an_inconsistent_state_is_refused() -> None:
    dfpc = manager()
    feed(dfpc, [visual(t) for t in times(5, 2)])
    state = dfpc.state()
    broken = replace(state, filter=replace(state.filter, stamps=np.zeros(0, np.int64)))
    with pytest.raises(InputError, match=r"PositionState\.stamps"):
        manager().resume(broken)


def test_an_imu_alone_yields_degraded_poses() -> None:
    out = poses(feed(manager(), [imu(t, LEVEL_ROTATION) for t in times(100, 4)]))
    assert out[-1].quality.reasons[0] == "source:imu"
    assert out[-1].quality.status is Status.DEGRADED
    assert error_m(out[-1]) < 0.1


def test_a_pose_without_covariance_has_a_low_weight() -> None:
    def without_covariance(sample: Sample) -> Sample:
        T = UncertainTransform(sample.value.transform.matrix)
        value = type(sample.value).from_transform(
            T, parent="mana/vo", child="mana/navcam_left", stamp_ns=sample.stamp_ns
        )
        return replace(sample, value=value)

    with_covariance = [visual(t) for t in times(5, 4)]
    sigma = [
        np.trace(poses(feed(manager(), samples))[-1].value.transform.covariance)
        for samples in ([without_covariance(s) for s in with_covariance], with_covariance)
    ]
    assert sigma[0] > sigma[1]
