# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixes, lidar, joints, late measurements, two times, pins and restarts of the position manager."""

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
from tests.unit.cdff_core.dfpcs.position_manager.test_position_manager import (
    MS,
    T0,
    T_SITE_ODOM,
    error_m,
    feed,
    frames,
    imu,
    manager,
    pose,
    poses,
    times,
    truth,
    visual,
    wheels,
)

LEVEL = np.eye(3)
URDF = """<robot name="mana"><link name="base"/><link name="mast"/><link name="head"/>
<joint name="lift" type="fixed"><parent link="base"/><child link="mast"/><origin xyz="0 0 1"/></joint>
<joint name="pan" type="revolute"><parent link="mast"/><child link="head"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def felt(end_s: float, slip: float = 1.0) -> list[Sample]:
    return [wheels(t, slip) for t in times(10, end_s)] + [imu(t, LEVEL) for t in times(100, end_s)]


def fix(t_s: float, shift: np.ndarray, sigma: float = 0.05, parent: str = "site") -> Sample:
    T = T_SITE_ODOM @ truth(t_s) if parent == "site" else se3.inverse(truth(1.0)) @ truth(t_s)
    C = sigma**2 * np.diag([1, 1, 1, 0.01, 0.01, 0.01])
    return pose("fix", t_s, se3.transform(T[:3, :3], T[:3, 3] + shift), C, parent, "mana/base", Status.OK)


def test_fixes_take_out_what_the_wheels_drifted() -> None:
    slipping = felt(8, 1.3)
    lost = poses(feed(manager(), slipping))[-1]
    out = poses(feed(manager(fix_weighting="kalman"), [*slipping, *[fix(t, np.zeros(3)) for t in (4.0, 6.0, 8.0)]]))
    assert out[-1].quality.reasons[0] == "source:fix"
    assert error_m(out[-1]) < 0.5 * error_m(lost)
    assert out[-1].quality.status is Status.OK


def test_fixes_that_share_an_error_are_not_averaged_but_those_of_their_own_are() -> None:
    many = [fix(t, np.zeros(3)) for t in times(2, 8, 2.0)]
    sigma = {}
    for weighting in ("intersection", "kalman"):
        last = poses(feed(manager(fix_weighting=weighting), felt(8) + many))[-1]
        sigma[weighting] = np.sqrt(np.trace(last.value.transform.covariance[:3, :3]))
    assert sigma["intersection"] > 0.03
    assert sigma["kalman"] < 0.8 * sigma["intersection"]


def test_a_fix_that_contradicts_all_else_is_refused_and_counted() -> None:
    samples = [*felt(6), *[visual(t) for t in times(5, 6)], fix(5.05, np.array([9.0, 0, 0]))]
    out = poses(feed(manager(), samples))
    assert error_m(out[-1]) < 0.01
    assert out[-1].quality.metrics["refused_fix"] == 1.0
    assert any("fix_refused" in o.quality.reasons for o in out)


def test_a_map_of_its_own_is_placed_by_its_first_pose_and_then_holds_the_robot() -> None:
    held = [fix(t, np.zeros(3), 0.01, "mana/slam") for t in times(2, 8, 1.0)]
    drifting, kept = (poses(feed(manager(fix_weighting="kalman"), felt(8, 1.3) + more))[-1] for more in ([], held))
    assert error_m(kept) < 0.25 * error_m(drifting)


def test_an_absolute_fix_goes_in_beside_a_map_s_pose_and_silences_nobody() -> None:
    first = fix(2.0, np.zeros(3), 0.01, "mana/slam")
    of_map = [first, *[fix(t, np.array([0.5, 0, 0]), 0.2, "mana/slam") for t in times(2, 8, 2.5)]]
    absolute = [replace(fix(t, np.zeros(3), 0.02), port="absolute_fix") for t in (4.0, 8.0)]
    drifting, kept = (poses(feed(manager(), felt(8) + of_map + more))[-1] for more in ([], absolute))
    assert error_m(kept) < 0.5 * error_m(drifting)
    assert "refused_absolute_fix" not in kept.quality.metrics
    alone = poses(feed(manager(), felt(8, 1.3) + absolute[:1]))
    after = [o.t1_ns for o in alone if T0 + 4_000 * MS <= o.t1_ns < T0 + 5_000 * MS]
    assert len(after) > 8  # the wheels go on being published


def test_lidar_odometry_drives_where_there_is_no_vision() -> None:
    lidar = [replace(visual(t), port="lidar_odometry") for t in times(5, 6)]
    out = poses(feed(manager(), felt(6, 1.2) + lidar))
    assert out[-1].quality.reasons[0] == "source:lidar"
    assert error_m(out[-1]) < 0.01


CORRELATED = {
    "correlated": ["visual_odometry", "lidar_odometry"], "lidar_scale": 1.0,
    "lidar_increment": {"floor_m": 0.00005, "floor_rad": 0.00001},
}  # fmt: skip


def doubled(begin_s: float = 0.0) -> list[Sample]:
    """Vision from the start, and from a time on once more as if it were another source."""
    return [visual(t) for t in times(5, 6)] + [replace(visual(t), port="lidar_odometry") for t in times(5, 6, begin_s)]


@pytest.mark.parametrize("begin_s", [0.0, 3.0])
def test_a_source_that_is_given_twice_makes_nothing_surer_where_both_are_said_to_share_errors(begin_s: float) -> None:
    def found(samples: list[Sample], **config: object) -> np.ndarray:
        return np.asarray(poses(feed(manager(**config), samples))[-1].value.transform.covariance)

    alone = found([visual(t) for t in times(5, 6)])
    both = found(doubled(begin_s), **CORRELATED)
    assert np.linalg.eigvalsh(both - alone)[0] > -0.005 * np.trace(alone)
    as_if_independent = found(doubled(begin_s), **{**CORRELATED, "correlated": []})
    assert np.trace(as_if_independent[:3, :3]) < np.trace(alone[:3, :3])


def test_it_does_not_matter_which_of_odometries_that_share_errors_came_first() -> None:
    def late(port: str) -> list[Sample]:
        samples = felt(6) + doubled()
        return sorted(samples, key=lambda s: (s.stamp_ns + (700 * MS if s.port == port else 0), s.port))

    found = []
    for port in ("", "visual_odometry", "lidar_odometry"):
        dfpc = manager(**CORRELATED)
        feed(dfpc, late(port), in_order=False)
        found.append(dfpc.get_pose("site", "mana/base", T0 + 6_000 * MS).transform)
    for other in found[1:]:
        np.testing.assert_allclose(other.matrix, found[0].matrix, atol=1e-9)
        np.testing.assert_allclose(other.covariance, found[0].covariance, rtol=1e-6, atol=1e-12)


def test_measurements_in_any_order_end_in_the_same_estimate(rng: np.random.Generator) -> None:
    samples = felt(6, 1.1) + [visual(t) for t in times(5, 6)] + [fix(4.0, np.zeros(3))]
    ordered = manager()
    feed(ordered, samples)
    shuffled = manager()
    late = sorted(samples, key=lambda s: (s.stamp_ns + (0 if s.port == "imu" else rng.integers(0, 900) * MS), s.port))
    feed(shuffled, late, in_order=False)
    for dfpc in (ordered, shuffled):
        dfpc.finish()
    a, b = (d.get_pose("site", "mana/base", T0 + 6_000 * MS).transform for d in (ordered, shuffled))
    np.testing.assert_allclose(a.matrix, b.matrix, atol=2e-4)
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=0.05, atol=2e-6)


def test_what_comes_later_than_the_memory_is_refused() -> None:
    dfpc = manager(memory_s=2.0)
    feed(dfpc, felt(12))
    before = dfpc.get_pose("site", "mana/base", -1).transform.matrix
    feed(dfpc, [fix(3.0, np.array([0.1, 0, 0]))])
    np.testing.assert_array_equal(dfpc.get_pose("site", "mana/base", -1).transform.matrix, before)


def test_a_motion_between_two_times_has_the_error_of_the_motion_alone() -> None:
    dfpc = manager()
    feed(dfpc, felt(10) + [visual(t) for t in times(5, 10)])
    a, b = T0 + 8_030 * MS, T0 + 9_010 * MS
    moved = dfpc.call(
        "get_transform", {"parent": "mana/base", "parent_t_ns": str(a), "child": "mana/base", "child_t_ns": str(b)}
    )
    np.testing.assert_allclose(moved.transform.matrix, se3.inverse(truth(8.03)) @ truth(9.01), atol=3e-3)
    alone = np.trace(moved.transform.covariance[:3, :3])
    whole = np.trace(dfpc.get_pose("site", "mana/base", b).transform.covariance[:3, :3])
    assert alone < 0.1 * whole
    back = dfpc.get_transform("mana/base", b, "mana/base", a).transform
    np.testing.assert_allclose(back.matrix @ moved.transform.matrix, np.eye(4), atol=1e-9)
    camera = dfpc.get_transform("site", a, "mana/navcam_left", b).transform
    np.testing.assert_allclose(camera.matrix, dfpc.get_pose("site", "mana/navcam_left", b).transform.matrix)
    # The frame in which the robot began does not have the error of where that was surveyed.
    of_odom = dfpc.get_pose("mana/odom", "mana/base", b).transform
    np.testing.assert_allclose(of_odom.matrix, truth(9.01), atol=0.01)
    assert np.trace(of_odom.covariance[:3, :3]) < whole


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
        list(dfpc.step(Sample("joints", T0, 0, Joints(Time.from_ns(T0), ("pan",), (JointState(position=2.0),)))))


def test_old_times_are_thinned_then_forgotten_but_pinned_ones_stay() -> None:
    dfpc = manager(memory_s=1.0, dense_s=2.0, thin_s=1.0, history_s=6.0, trajectory_period_s=1.0)
    feed(dfpc, [visual(t) for t in times(5, 4)])
    pinned = dfpc.call("pin", {"t_ns": str(T0 + 3_100 * MS)}).transform.matrix
    feed(dfpc, [visual(t) for t in times(5, 20, 4.2)])
    stamps = dfpc.get_trajectory(-1, -1).stamps_ns
    assert np.sum(stamps < T0 + 13_000 * MS) < 8
    assert np.diff(stamps[stamps > T0 + 15_000 * MS]).max() <= 1_000 * MS
    np.testing.assert_allclose(dfpc.get_pose("site", "mana/base", T0 + 3_100 * MS).transform.matrix, pinned)
    np.testing.assert_array_equal(dfpc.store.get("pins").stamps_ns, [T0 + 3_100 * MS])
    with pytest.raises(ExtrapolationError, match="forgotten"):
        dfpc.get_pose("site", "mana/base", T0 + 8_000 * MS)
    dfpc.unpin(T0 + 3_100 * MS)
    with pytest.raises(ProductNotFoundError, match="not pinned"):
        dfpc.unpin(T0 + 3_100 * MS)


@pytest.mark.req("CDFF-CORE-077")
def test_a_restart_goes_on_where_it_was_and_wheels_bridge_the_time_in_between() -> None:
    before = manager()
    feed(before, [*felt(5, 1.05), *[visual(t) for t in times(5, 5)]])
    before.pin(T0 + 2_000 * MS)
    state = decode("PositionState", encode(before.state(), "uper"), "uper")
    after = manager()
    after.resume(state)
    asked = [
        d.get_transform("mana/base", T0 + 2_000 * MS, "mana/base", T0 + 4_000 * MS).transform for d in (before, after)
    ]
    np.testing.assert_allclose(asked[0].matrix, asked[1].matrix, atol=1e-9)
    np.testing.assert_allclose(asked[0].covariance, asked[1].covariance, atol=1e-12)
    np.testing.assert_array_equal(after.get_pins().stamps_ns, [T0 + 2_000 * MS])
    gone = [s for s in felt(12, 1.05) if s.stamp_ns > T0 + 8_000 * MS]
    out = poses(feed(after, gone))
    assert error_m(out[-1]) < 0.25
    assert "resumed" in out[-1].quality.reasons
    with pytest.raises(InputError, match="PositionState"):
        after.resume(Joints())


def test_a_state_of_parts_that_do_not_fit_is_refused() -> None:
    dfpc = manager()
    feed(dfpc, [visual(t) for t in times(5, 2)])
    state = dfpc.state()
    broken = replace(state, filter=replace(state.filter, stamps=np.zeros(0, np.int64)))
    with pytest.raises(InputError, match=r"PositionState\.stamps"):
        manager().resume(broken)


def test_an_imu_alone_carries_the_robot_for_a_while_and_says_so() -> None:
    out = poses(feed(manager(), [imu(t, LEVEL) for t in times(100, 4)]))
    assert out[-1].quality.reasons[0] == "source:imu"
    assert out[-1].quality.status is Status.DEGRADED
    assert error_m(out[-1]) < 0.1


def test_a_pose_without_covariance_is_believed_little() -> None:
    def bare(sample: Sample) -> Sample:
        T = UncertainTransform(sample.value.transform.matrix)
        value = type(sample.value).from_transform(
            T, parent="mana/vo", child="mana/navcam_left", stamp_ns=sample.stamp_ns
        )
        return replace(sample, value=value)

    stated = [visual(t) for t in times(5, 4)]
    sigma = [
        np.trace(poses(feed(manager(), samples))[-1].value.transform.covariance)
        for samples in ([bare(s) for s in stated], stated)
    ]
    assert sigma[0] > sigma[1]
