# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Joints of a robot over restarts and around pinned times."""

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
from tests.unit.cdff_core.dfpcs.position_manager.test_position_manager import (
    MS,
    T0,
    feed,
    frames,
    times,
    visual,
)
from tests.unit.cdff_core.dfpcs.position_manager.test_sources import URDF


def turning(**config: object) -> PositionManager:
    """A manager of a robot with a head that turns."""
    made = PositionManager()
    made.configure(config, DfpcContext("mana", frames(), urdf=URDF))
    return made


def pan(t_s: float) -> Sample:
    stamp_ns = T0 + round(t_s * 1000) * MS
    value = Joints(Time.from_ns(stamp_ns), ("pan",), (JointState(position=0.04 * t_s),))
    return Sample("joints", stamp_ns, 0, value)


def driven(end_s: float, begin_s: float = 0.0) -> list[Sample]:
    return [s for t in times(5, end_s, begin_s) for s in (visual(t), pan(t))]


def head(dfpc: PositionManager, t_s: float, parent: str = "site") -> np.ndarray:
    return dfpc.get_pose(parent, "mana/head", T0 + round(t_s * 1000) * MS).transform.matrix


def test_joints_are_where_they_were_after_a_restart() -> None:
    before = turning()
    feed(before, driven(4.0))
    after = turning()
    after.resume(decode("PositionState", encode(before.state(), "uper"), "uper"))
    for t_s in (1.3, 2.0, 4.0):
        np.testing.assert_allclose(head(after, t_s), head(before, t_s), atol=1e-9)
    np.testing.assert_allclose(head(after, 4.0, "mana/base"), se3.transform(se3.exp_so3([0, 0, 0.16]), [0, 0, 1]))


def test_a_pinned_time_has_its_joints_however_old_and_over_a_restart_too() -> None:
    dfpc = turning(memory_s=1.0, dense_s=2.0, history_s=6.0, trajectory_period_s=1.0)
    feed(dfpc, driven(3.0))
    dfpc.pin(T0 + 2_300 * MS)
    pinned = head(dfpc, 2.3)
    feed(dfpc, driven(20.0, 3.2))
    again = turning()
    again.resume(dfpc.state())
    for asked in (dfpc, again):
        np.testing.assert_allclose(head(asked, 2.3), pinned, atol=1e-9)
        with pytest.raises(ExtrapolationError, match="forgotten"):
            head(asked, 8.0, "mana/base")
    dfpc.unpin(T0 + 2_300 * MS)
    feed(dfpc, driven(21.0, 20.2))
    assert len(dfpc.state().joints.values) < 40


def test_joints_of_a_state_that_do_not_fit_together_are_refused() -> None:
    dfpc = turning()
    feed(dfpc, driven(2.0))
    state = dfpc.state()
    broken = replace(state, joints=replace(state.joints, counts=np.array([3], np.int64)))
    with pytest.raises(InputError, match=r"PositionState\.joints"):
        turning().resume(broken)
