# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Position manager with wrong stamps, jumps of the mission clock, and interruptions of all sources."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.types import TransformWithCovariance
from cdff_core.dfns.kalman_prediction.inertial_error_state import InertialErrorState
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.mission_time import MissionTime
from tests.support.position_manager_samples import (
    HOUR_NS,
    MS,
    T0,
    T_SITE_ODOM,
    delayed,
    error_m,
    feed,
    fix,
    manager,
    poses,
    times,
    true_pose,
    visual,
    wheels,
    wheels_and_imu,
    wheels_imu_and_vision,
)


def count_predictions(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that grows with each step of the strapdown integration."""
    steps: list[int] = []
    process = InertialErrorState.process

    def counting_process(node: InertialErrorState, inputs: Any) -> Any:
        steps.append(1)
        return process(node, inputs)

    monkeypatch.setattr(InertialErrorState, "process", counting_process)
    return steps


@pytest.mark.parametrize(
    ("port", "ahead_s"), [("odometry", 3000), ("imu", 600), ("visual_odometry", 10**8), ("fix", 30)]
)
def test_a_single_sample_with_a_future_stamp_is_refused_and_counted(port: str, ahead_s: int) -> None:
    future_sample = next(
        s for s in [*wheels_imu_and_vision(1.9, 2.0), fix(2.0, np.zeros(3))] if s.port == port
    )
    dfpc = manager()
    feed(dfpc, wheels_imu_and_vision(0.0, 2.0))
    assert feed(dfpc, [delayed(future_sample, ahead_s * 1000 * MS)]) == []
    out = poses(feed(dfpc, wheels_imu_and_vision(2.0, 4.0)))
    assert out[-1].t1_ns == T0 + 4_000 * MS
    assert max(map(error_m, out)) < 0.01
    name = {"odometry": "wheels", "visual_odometry": "vo"}.get(port, port)
    assert out[-1].quality.metrics[f"refused_{name}"] == 1.0


def test_a_source_with_a_wrong_clock_does_not_affect_the_others() -> None:
    ordered = sorted(wheels_imu_and_vision(4.0, 8.0), key=lambda s: (s.stamp_ns, s.port))
    wrong = [delayed(s, 600_000 * MS) if s.port == "odometry" else s for s in ordered]
    dfpc = manager()
    feed(dfpc, wheels_imu_and_vision(0.0, 4.0))
    out = poses(feed(dfpc, wrong, in_order=False))
    assert out[-1].t1_ns == T0 + 8_000 * MS
    assert max(map(error_m, out)) < 0.01


def test_after_a_forward_jump_of_the_mission_clock_the_wheels_bridge_the_gap(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dfpc = manager()
    feed(dfpc, wheels_imu_and_vision(0.0, 4.0))
    steps = count_predictions(monkeypatch)
    out = poses(feed(dfpc, [delayed(s, HOUR_NS) for s in wheels_imu_and_vision(6.0, 10.0)]))
    assert len(steps) < 2_000
    assert out[0].t1_ns <= T0 + HOUR_NS + 6_500 * MS
    assert out[-1].t1_ns == T0 + HOUR_NS + 10_000 * MS
    result = out[-1].value.transform
    assert np.linalg.norm(result.matrix - T_SITE_ODOM @ true_pose(10.0)) < 0.1
    assert np.sqrt(np.trace(result.covariance[:3, :3])) < 0.5
    with pytest.raises(ExtrapolationError, match="never known"):
        dfpc.get_pose("site", "mana/base", T0 + HOUR_NS // 2)


def test_after_a_long_interruption_without_wheels_the_position_is_unknown() -> None:
    dfpc = manager()
    feed(dfpc, [visual(t) for t in times(5, 4)])
    out = poses(feed(dfpc, [delayed(visual(t), HOUR_NS) for t in times(5, 6, 4.2)]))
    result = out[-1].value.transform
    assert np.linalg.norm(result.matrix[:3, 3] - (T_SITE_ODOM @ true_pose(4.0))[:3, 3]) < 1.0
    assert np.sqrt(result.covariance[0, 0]) > 1_000.0
    fixed = poses(feed(dfpc, [delayed(fix(6.1, np.zeros(3)), HOUR_NS)]))[-1].value.transform
    assert np.linalg.norm(fixed.matrix[:3, 3] - (T_SITE_ODOM @ true_pose(6.1))[:3, 3]) < 0.2
    assert np.linalg.eigvalsh(fixed.covariance)[0] > -1e-9


def test_a_backward_jump_of_the_mission_clock_restarts_the_timeline() -> None:
    dfpc = manager()
    feed(dfpc, wheels_imu_and_vision(0.0, 4.0))
    out = poses(feed(dfpc, [delayed(s, -HOUR_NS) for s in wheels_imu_and_vision(0.0, 5.0)]))
    assert out[-1].t1_ns == T0 - HOUR_NS + 5_000 * MS
    assert np.linalg.norm(out[-1].value.transform.matrix - T_SITE_ODOM @ true_pose(5.0)) < 0.01
    assert dfpc.get_trajectory(-1, -1).stamps_ns[-1] == out[-1].t1_ns


def test_a_repeated_log_restarts_the_timeline() -> None:
    dfpc = manager(timeline={"memory_s": 2.0})
    feed(dfpc, wheels_imu_and_vision(0.0, 10.0))
    out = poses(feed(dfpc, wheels_imu_and_vision(0.0, 5.0)))
    assert out[-1].t1_ns == T0 + 5_000 * MS
    assert error_m(out[-1]) < 0.01


def test_a_delayed_burst_of_one_source_is_not_a_backward_jump() -> None:
    dfpc = manager(timeline={"memory_s": 2.0})
    feed(dfpc, wheels_and_imu(12.0))
    assert feed(dfpc, [visual(t) for t in times(5, 8)]) == []
    out = poses(feed(dfpc, [s for s in wheels_and_imu(13.0) if s.stamp_ns > T0 + 12_000 * MS]))
    assert out[-1].t1_ns == T0 + 13_000 * MS
    assert dfpc.get_trajectory(-1, -1).stamps_ns[0] == T0
    assert out[-1].quality.metrics["refused_vo"] == len(times(5, 8))


@pytest.mark.parametrize("period_s", [6, 31, 300])
def test_a_single_source_with_a_long_period_is_accepted(period_s: int) -> None:
    mission_time, arrivals = MissionTime(PositionManagerConfig()), []
    jitter_ms = np.random.default_rng(1).integers(-2000, 2000, 60)
    for k, late_ms in enumerate(jitter_ms):
        arrivals.append(mission_time.admit(delayed(visual(0.0), (k * period_s * 1000 + int(late_ms)) * MS)))
    assert sum(len(a.accepted) for a in arrivals) >= 58
    assert not any(a.refused or a.jumped_back for a in arrivals)


def test_late_visual_odometry_while_only_joints_are_published_is_not_a_backward_jump() -> None:
    mission_time = MissionTime(PositionManagerConfig())
    joints = replace(wheels(0.0), port="joints")
    parked = [*wheels_imu_and_vision(0.0, 45.0), *(delayed(joints, t * 1000 * MS) for t in (48, 52, 56))]
    for sample in sorted(parked, key=lambda s: s.stamp_ns):
        mission_time.admit(sample)
    late = [mission_time.admit(visual(t)) for t in (25.0, 29.0, 32.0)]
    assert not any(a.accepted or a.jumped_back for a in late)
    jumps_back = [
        mission_time.admit(s).jumped_back
        for s in sorted(wheels_imu_and_vision(0.0, 5.0), key=lambda s: s.stamp_ns)
    ]
    assert sum(jumps_back) == 1


def test_a_first_sample_with_a_future_stamp_does_not_set_the_time() -> None:
    dfpc = manager()
    feed(dfpc, [delayed(wheels(0.0), HOUR_NS)])
    out = poses(feed(dfpc, wheels_imu_and_vision(0.0, 5.0)))
    assert out[-1].t1_ns == T0 + 5_000 * MS
    assert error_m(out[-1]) < 0.01


def test_a_restart_after_a_day_needs_few_prediction_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    stopped = manager()
    feed(stopped, wheels_imu_and_vision(0.0, 4.0))
    stopped.pin(T0 + 2_000 * MS)
    restarted = manager()
    restarted.resume(stopped.state())
    steps = count_predictions(monkeypatch)
    out: list[Output] = poses(
        feed(restarted, [delayed(s, 24 * HOUR_NS) for s in wheels_imu_and_vision(6.0, 9.0)])
    )
    assert len(steps) < 2_000
    assert np.linalg.norm(out[-1].value.transform.matrix - T_SITE_ODOM @ true_pose(9.0)) < 0.1
    np.testing.assert_array_equal(restarted.get_pins().stamps_ns, [T0 + 2_000 * MS])


def test_the_buffer_of_a_stopped_clock_is_bounded() -> None:
    mission_time = MissionTime(PositionManagerConfig())
    for sample in wheels_imu_and_vision(0.0, 2.0):
        mission_time.admit(sample)
    value = TransformWithCovariance.from_transform(
        UncertainTransform(np.eye(4)), parent="mana/odom", child="mana/base", stamp_ns=T0 + HOUR_NS
    )
    stuck = Sample("odometry", T0 + HOUR_NS, 0, value)
    admissions = [mission_time.admit(stuck) for _ in range(5_000)]
    assert not any(a.accepted for a in admissions)
    assert sum(len(a.refused) for a in admissions) == 5_000 - 4_096
    assert mission_time.admit(wheels_imu_and_vision(2.0, 3.0)[-1]).accepted
