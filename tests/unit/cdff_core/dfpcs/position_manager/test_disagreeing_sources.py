# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sources that contradict the others, or whose sensor has no place on the robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.errors import FrameNotFoundError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.product import Status
from cdff_common.types import Joints, JointState, Time
from cdff_core.dfpcs.position_manager.compound import PositionManager
from cdff_core.dfpcs.position_manager.measurement import Measurement, MeasurementResult
from cdff_core.dfpcs.position_manager.measurement_history import MeasurementHistory
from tests.support.position_manager_samples import (
    T0,
    URDF,
    error_m,
    feed,
    frames,
    manager,
    pose,
    poses,
    times,
    true_pose,
    visual,
    wheels_and_imu,
)

#: Position of the joint of the mast.
PAN_RAD = 0.1


def in_frame(sample: Sample, frame: str) -> Sample:
    """Return a pose of visual odometry whose camera is in another frame."""
    value = sample.value
    moved_pose = type(value).from_transform(
        value.transform, parent=value.parent_frame, child=frame, stamp_ns=sample.stamp_ns
    )
    return replace(sample, value=moved_pose)


def from_mast(t_s: float) -> Sample:
    """Return a pose of visual odometry of a camera on the mast, whose joint is at 0.1 rad."""
    T_base_head = se3.transform(se3.exp_so3([0.0, 0.0, PAN_RAD]), [0.0, 0.0, 1.0])
    T = se3.inverse(true_pose(0.0) @ T_base_head) @ true_pose(t_s) @ T_base_head
    covariance = 1e-6 * (1.0 + t_s) * np.eye(6)
    return pose("visual_odometry", t_s, T, covariance, "mana/vo", "mana/head", Status.OK)


def with_urdf() -> PositionManager:
    dfpc = PositionManager()
    dfpc.configure({}, DfpcContext("mana", frames(), urdf=URDF))
    return dfpc


def joint(t_s: float) -> Sample:
    """Return the position of the mast."""
    stamp_ns = T0 + round(t_s * 1000) * 1_000_000
    joints = Joints(
        timestamp=Time.from_ns(stamp_ns), names=("pan",), elements=(JointState(position=PAN_RAD),)
    )
    return Sample("joints", stamp_ns, 0, joints)


def test_a_source_most_of_whose_increments_are_refused_degrades_the_pose_and_is_named() -> None:
    wrong = se3.exp_so3([0.0, 0.0, np.pi / 2])
    samples = wheels_and_imu(12) + [visual(t, mount=wrong) for t in times(5, 12)]
    last = poses(feed(manager(), samples))[-1]
    assert last.quality.status is Status.DEGRADED
    assert any(reason.startswith("refused:vo_") for reason in last.quality.reasons)


def test_a_source_that_agrees_is_no_reason() -> None:
    samples = wheels_and_imu(8) + [visual(t) for t in times(5, 8)]
    last = poses(feed(manager(), samples))[-1]
    assert last.quality.status is Status.OK
    assert not any(reason.startswith(("refused", "unplaced")) for reason in last.quality.reasons)


def test_a_camera_on_a_mast_without_joint_values_waits_and_the_rest_goes_on() -> None:
    dfpc = with_urdf()
    cameras = [from_mast(t) for t in times(5, 6)]
    before = poses(feed(dfpc, wheels_and_imu(6) + cameras))
    assert {o.quality.status for o in before[5:]} == {Status.DEGRADED}
    assert "unplaced:vo_mana/head" in before[-1].quality.reasons
    assert before[-1].quality.metrics["refused_vo"] == len(cameras) - 1  # the first pose starts the timeline
    assert error_m(before[-1]) < 0.1
    later = [s for s in wheels_and_imu(9) if s.stamp_ns > T0 + 6_000_000_000]
    later += [joint(6.05), *[from_mast(t) for t in times(5, 9, 6.2)]]
    after = poses(feed(dfpc, later))
    assert not any(r.startswith("unplaced") for r in after[-1].quality.reasons)
    assert after[-1].quality.reasons[0] == "source:vo"


def test_a_frame_that_does_not_exist_is_named_and_the_checkpoint_resumes() -> None:
    dfpc = with_urdf()
    samples = wheels_and_imu(6) + [in_frame(visual(t), "mana/navcam_lef") for t in times(5, 6)]
    out = poses(feed(dfpc, samples))
    assert "unplaced:vo_mana/navcam_lef" in out[-1].quality.reasons
    state = dfpc.state()
    restarted = with_urdf()
    restarted.resume(state)
    more = poses(feed(restarted, [s for s in samples if s.stamp_ns > T0 + 6_000_000_000] or [samples[-1]]))
    assert restarted.get_pose("site", "mana/base", -1) is not None
    assert all(o.value is not None for o in more)


class RefusingEstimator:
    """Estimator that cannot process one source."""

    def update(self, estimate: Measurement, m: Measurement) -> tuple[Measurement, MeasurementResult]:
        if m.source == "fix":
            raise FrameNotFoundError(f"frame {m.child!r}")
        return m, MeasurementResult(True)


class Stamps:
    """Timeline of stamps."""

    def __init__(self) -> None:
        self.stamps: list[int] = []

    def append(self, estimate: Measurement) -> None:
        self.stamps.append(estimate.stamp_ns)

    def remove_after(self, stamp_ns: int) -> None:
        self.stamps = [s for s in self.stamps if s <= stamp_ns]


def test_a_measurement_that_cannot_be_processed_leaves_the_history_unchanged() -> None:
    timeline = Stamps()
    history = MeasurementHistory(RefusingEstimator(), timeline, 1000)  # type: ignore[arg-type]
    history.start(Measurement(0, "imu"))  # type: ignore[arg-type]
    for stamp_ns in (10, 20, 30):
        history.insert(Measurement(stamp_ns, "odometry"))
    with pytest.raises(FrameNotFoundError):
        history.insert(Measurement(15, "fix", child="mana/mast_cam"))
    assert timeline.stamps == [0, 10, 20, 30]
    history.insert(Measurement(40, "odometry"))
    history.insert(Measurement(12, "odometry"))
    assert timeline.stamps == [0, 10, 12, 20, 30, 40]
    assert history.newest.stamp_ns == 40
