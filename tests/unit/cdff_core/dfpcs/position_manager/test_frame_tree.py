# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Joints of the position manager: stored over restarts and at pinned times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.codecs import decode, encode
from cdff_common.errors import ExtrapolationError, FrameNotFoundError, InputError
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.types import Joints, JointState, Time
from cdff_core.dfpcs.position_manager.compound import PositionManager
from cdff_core.dfpcs.position_manager.frame_tree import JointValues, RobotFrames
from tests.support.position_manager_samples import MS, T0, URDF, feed, frames, times, visual


def manager_with_head(**config: object) -> PositionManager:
    """Return the manager of a robot with a rotating head."""
    dfpc = PositionManager()
    dfpc.configure(config, DfpcContext("mana", frames(), urdf=URDF))
    return dfpc


def pan(t_s: float) -> Sample:
    stamp_ns = T0 + round(t_s * 1000) * MS
    value = Joints(Time.from_ns(stamp_ns), ("pan",), (JointState(position=0.04 * t_s),))
    return Sample("joints", stamp_ns, 0, value)


def drive(end_s: float, start_s: float = 0.0) -> list[Sample]:
    return [s for t in times(5, end_s, start_s) for s in (visual(t), pan(t))]


def head(dfpc: PositionManager, t_s: float, parent: str = "site") -> np.ndarray:
    return dfpc.get_pose(parent, "mana/head", T0 + round(t_s * 1000) * MS).transform.matrix


def test_joints_are_restored_after_a_restart() -> None:
    stopped = manager_with_head()
    feed(stopped, drive(4.0))
    restarted = manager_with_head()
    restarted.resume(decode("PositionState", encode(stopped.state(), "uper"), "uper"))
    for t_s in (1.3, 2.0, 4.0):
        np.testing.assert_allclose(head(restarted, t_s), head(stopped, t_s), atol=1e-9)
    np.testing.assert_allclose(
        head(restarted, 4.0, "mana/base"), se3.transform(se3.exp_so3([0, 0, 0.16]), [0, 0, 1])
    )


def test_joint_values_at_a_pinned_time_remain_available_also_after_a_restart() -> None:
    dfpc = manager_with_head(
        timeline={"memory_s": 1.0, "dense_s": 2.0, "history_s": 6.0}, publication={"trajectory_period_s": 1.0}
    )
    feed(dfpc, drive(3.0))
    dfpc.pin(T0 + 2_300 * MS)
    pinned = head(dfpc, 2.3)
    feed(dfpc, drive(20.0, 3.2))
    restarted = manager_with_head()
    restarted.resume(dfpc.state())
    for manager in (dfpc, restarted):
        np.testing.assert_allclose(head(manager, 2.3), pinned, atol=1e-9)
        with pytest.raises(ExtrapolationError, match="evicted"):
            head(manager, 8.0, "mana/base")
    dfpc.unpin(T0 + 2_300 * MS)
    feed(dfpc, drive(21.0, 20.2))
    assert len(dfpc.state().joints.values) < 40


def test_inconsistent_joints_of_a_state_are_refused() -> None:
    dfpc = manager_with_head()
    feed(dfpc, drive(2.0))
    state = dfpc.state()
    broken = replace(state, joints=replace(state.joints, counts=np.array([3], np.int64)))
    with pytest.raises(InputError, match=r"PositionState\.joints"):
        manager_with_head().resume(broken)


MIMIC_URDF = """<robot name="mana"><link name="base"/><link name="left"/><link name="right"/>
<joint name="rocker" type="revolute"><parent link="base"/><child link="left"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="bogie" type="revolute"><parent link="base"/><child link="right"/><axis xyz="0 0 1"/>
<mimic joint="rocker" multiplier="-0.5" offset="0.25"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def set_joint(tree: RobotFrames, name: str, value: float, stamp_ns: int, oldest_ns: int = 0) -> None:
    tree.set_joints(
        Joints(Time.from_ns(stamp_ns), (name,), (JointState(position=value),)), stamp_ns, oldest_ns
    )


def yaw(T: np.ndarray) -> float:
    return float(np.arctan2(T[1, 0], T[0, 0]))


def test_a_joint_that_mimics_another_follows_it() -> None:
    tree = RobotFrames("mana", frames(), MIMIC_URDF)
    assert tree.movable_joints == ("bogie", "rocker")
    set_joint(tree, "rocker", 0.4, MS)
    assert yaw(tree.mount("mana/left", MS)) == pytest.approx(0.4)
    assert yaw(tree.mount("mana/right", MS)) == pytest.approx(0.05)


def test_values_at_the_limits_are_accepted_and_beyond_them_refused() -> None:
    tree = RobotFrames("mana", frames(), URDF)
    for value in (1.0, -1.0, 1.0 + 9e-7, -1.0 - 9e-7):
        set_joint(tree, "pan", value, MS)
    for value in (1.0 + 2e-6, -1.0 - 2e-6):
        with pytest.raises(InputError, match=r"joint 'pan'.*expected -1 to 1"):
            set_joint(tree, "pan", value, MS)
    with pytest.raises(InputError, match="joint 'lift' is not movable in the URDF; movable are pan"):
        set_joint(tree, "lift", 0.0, MS)


def test_the_last_value_of_a_joint_holds_for_an_hour() -> None:
    tree = RobotFrames("mana", frames(), URDF)
    set_joint(tree, "pan", 0.5, MS)
    hour_ns = 3_600_000 * MS
    assert yaw(tree.mount("mana/head", MS + hour_ns)) == pytest.approx(0.5)
    assert tree.is_placed("mana/head", MS + hour_ns)
    assert not tree.is_placed("mana/head", MS + hour_ns + 1)
    assert not tree.is_placed("mana/nosuch", MS)


def test_stored_values_outside_the_urdf_are_skipped_and_gaps_are_restored() -> None:
    tree = RobotFrames("mana", frames(), URDF)
    stamps = np.array([1, 2, 3, 4], np.int64) * 1000 * MS
    stored = JointValues(stamps, np.array([0.1, 7.0, 0.3, 0.4]), {3000 * MS, 2000 * MS})
    tree.restore({"nosuch": stored, "pan": stored})
    (restored,) = tree.joint_values().values()
    np.testing.assert_array_equal(restored.stamps_ns, stamps[[0, 2, 3]])
    np.testing.assert_array_equal(restored.values, [0.1, 0.3, 0.4])
    assert restored.gaps_ns == {3000 * MS}
    assert yaw(tree.mount("mana/head", 3500 * MS)) == pytest.approx(0.35)
    assert not tree.is_placed("mana/head", 2000 * MS)  # within the gap


def test_values_of_removed_times_do_not_accumulate() -> None:
    tree = RobotFrames("mana", frames(), URDF)
    for k in range(400):
        set_joint(tree, "pan", 0.001 * k, k * MS, oldest_ns=(k - 5) * MS)
    (values,) = tree.joint_values().values()
    np.testing.assert_array_equal(values.stamps_ns[-5:], np.arange(395, 400) * MS)
    np.testing.assert_allclose(values.values, 0.001 * values.stamps_ns / MS)
    assert len(values.values) < 10


def test_frames_are_on_the_robot_or_of_the_site() -> None:
    tree = RobotFrames("mana", frames(), URDF)
    on_robot = {f: tree.is_on_robot(f) for f in ("mana/base", "mana/head", "mana/imu", "site", "mana/odom")}
    assert on_robot == {
        "mana/base": True, "mana/head": True, "mana/imu": True, "site": False, "mana/odom": False,
    }  # fmt: skip
    with pytest.raises(FrameNotFoundError, match=r"'mana/nosuch': unknown, expected one of .*mana/base"):
        tree.is_on_robot("mana/nosuch")
    np.testing.assert_array_equal(tree.site_pose("site"), np.eye(4))
    assert tree.site_pose("mana/base") is None
    assert tree.site_pose("mana/head") is None
    assert tree.site_pose("mana/nosuch") is None
    expected = frames().lookup("site", "mana/odom", 0).matrix
    np.testing.assert_allclose(tree.site_pose("mana/odom"), expected)


def test_a_robot_without_survey_starts_at_the_site_and_names_its_imu() -> None:
    tree = RobotFrames("mana", FrameGraph(), "")
    np.testing.assert_array_equal(tree.site_pose("mana/odom"), np.eye(4))
    assert (tree.imu, tree.movable_joints) == ("mana/imu", ())
    assert RobotFrames("mana", FrameGraph(), "", "mana/imu2").imu == "mana/imu2"


def test_only_stated_covariances_of_mounts_are_returned() -> None:
    context = FrameGraph()
    C = np.diag([1e-4, 2e-4, 3e-4, 1e-6, 2e-6, 3e-6])
    context.set_static("mana/base", "mana/lidar", UncertainTransform(np.eye(4), C))
    context.set_static("mana/base", "mana/camera", UncertainTransform(np.eye(4), np.zeros((6, 6))))
    context.set_static("mana/base", "mana/mast", UncertainTransform(np.eye(4)))
    tree = RobotFrames("mana", context, "")
    np.testing.assert_allclose(tree.mount_covariance("mana/lidar", 0), C)
    assert tree.mount_covariance("mana/camera", 0) is None
    assert tree.mount_covariance("mana/mast", 0) is None
