# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Joints of the position manager: stored over restarts and at pinned times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.codecs import decode, encode
from cdff_common.errors import ExtrapolationError, InputError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.types import Joints, JointState, Time
from cdff_core.dfpcs.position_manager.compound import PositionManager
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
