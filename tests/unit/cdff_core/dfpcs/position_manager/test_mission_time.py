# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stamps that are wrong, mission clocks that jump, and times in which nobody spoke."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.types import TransformWithCovariance
from cdff_core.dfpcs.position_manager.compound import PositionManager
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.mission_time import MissionTime
from tests.unit.cdff_core.dfpcs.position_manager.test_position_manager import (
    MS,
    T0,
    T_SITE_ODOM,
    error_m,
    feed,
    manager,
    poses,
    times,
    truth,
    visual,
    wheels,
)
from tests.unit.cdff_core.dfpcs.position_manager.test_sources import felt, fix

HOUR = 3_600_000 * MS


def at(sample: Sample, later_ns: int) -> Sample:
    """The same sample of a clock that is ahead."""
    return replace(sample, stamp_ns=sample.stamp_ns + later_ns)


def seen(begin_s: float, end_s: float) -> list[Sample]:
    """Wheels, IMU and vision."""
    samples = felt(end_s) + [visual(t) for t in times(5, end_s)]
    return [s for s in samples if s.stamp_ns > T0 + round(begin_s * 1000) * MS or begin_s == 0.0]


def predictions(dfpc: PositionManager, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Each step of the strapdown integration from now on."""
    steps: list[int] = []
    node = dfpc._estimator._prediction
    process = node.process

    def counted(inputs: object) -> object:
        steps.append(1)
        return process(inputs)

    monkeypatch.setattr(node, "process", counted)
    return steps


@pytest.mark.parametrize(
    ("port", "ahead_s"), [("odometry", 3000), ("imu", 600), ("visual_odometry", 10**8), ("fix", 30)]
)
def test_one_sample_of_the_future_is_refused_and_counted_and_poses_go_on(port: str, ahead_s: int) -> None:
    wild = next(s for s in [*seen(3.9, 4.0), fix(4.0, np.zeros(3))] if s.port == port)
    dfpc = manager()
    feed(dfpc, seen(0.0, 4.0))
    assert feed(dfpc, [at(wild, ahead_s * 1000 * MS)]) == []
    out = poses(feed(dfpc, seen(4.0, 8.0)))
    assert out[-1].t1_ns == T0 + 8_000 * MS
    assert max(map(error_m, out)) < 0.01
    name = {"odometry": "wheels", "visual_odometry": "vo"}.get(port, port)
    assert out[-1].quality.metrics[f"refused_{name}"] == 1.0


def test_a_source_whose_clock_is_wrong_does_not_take_the_others_along() -> None:
    as_they_come = sorted(seen(4.0, 8.0), key=lambda s: (s.stamp_ns, s.port))
    wrong = [at(s, 600_000 * MS) if s.port == "odometry" else s for s in as_they_come]
    dfpc = manager()
    feed(dfpc, seen(0.0, 4.0))
    out = poses(feed(dfpc, wrong, in_order=False))
    assert out[-1].t1_ns == T0 + 8_000 * MS
    assert max(map(error_m, out)) < 0.01


def test_a_mission_clock_that_jumps_ahead_is_followed_and_wheels_that_counted_on_bridge_the_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dfpc = manager()
    feed(dfpc, seen(0.0, 4.0))
    steps = predictions(dfpc, monkeypatch)
    out = poses(feed(dfpc, [at(s, HOUR) for s in seen(6.0, 10.0)]))
    assert len(steps) < 2_000
    assert out[0].t1_ns <= T0 + HOUR + 6_500 * MS
    assert out[-1].t1_ns == T0 + HOUR + 10_000 * MS
    found = out[-1].value.transform
    assert np.linalg.norm(found.matrix - T_SITE_ODOM @ truth(10.0)) < 0.1
    assert np.sqrt(np.trace(found.covariance[:3, :3])) < 0.5
    with pytest.raises(ExtrapolationError, match="never known"):
        dfpc.get_pose("site", "mana/base", T0 + HOUR // 2)


def test_after_a_long_silence_a_robot_without_wheels_may_be_anywhere_near() -> None:
    dfpc = manager()
    feed(dfpc, [visual(t) for t in times(5, 4)])
    out = poses(feed(dfpc, [at(visual(t), HOUR) for t in times(5, 6, 4.2)]))
    found = out[-1].value.transform
    assert np.linalg.norm(found.matrix[:3, 3] - (T_SITE_ODOM @ truth(4.0))[:3, 3]) < 1.0
    assert np.sqrt(found.covariance[0, 0]) > 1_000.0
    fixed = poses(feed(dfpc, [at(fix(6.1, np.zeros(3)), HOUR)]))[-1].value.transform
    assert np.linalg.norm(fixed.matrix[:3, 3] - (T_SITE_ODOM @ truth(6.1))[:3, 3]) < 0.2
    assert np.linalg.eigvalsh(fixed.covariance)[0] > -1e-9


def test_a_mission_clock_that_went_back_begins_anew() -> None:
    dfpc = manager()
    feed(dfpc, seen(0.0, 4.0))
    out = poses(feed(dfpc, [at(s, -HOUR) for s in seen(0.0, 5.0)]))
    assert out[-1].t1_ns == T0 - HOUR + 5_000 * MS
    assert np.linalg.norm(out[-1].value.transform.matrix - T_SITE_ODOM @ truth(5.0)) < 0.01
    assert dfpc.get_trajectory(-1, -1).stamps_ns[-1] == out[-1].t1_ns


def test_a_log_that_is_played_again_begins_anew_though_its_times_are_inside_the_time_line() -> None:
    dfpc = manager(memory_s=2.0)
    feed(dfpc, seen(0.0, 12.0))
    out = poses(feed(dfpc, seen(0.0, 5.0)))
    assert out[-1].t1_ns == T0 + 5_000 * MS
    assert error_m(out[-1]) < 0.01


def test_a_burst_of_one_source_that_was_held_up_does_not_turn_the_clock_back() -> None:
    dfpc = manager(memory_s=2.0)
    feed(dfpc, felt(12.0))
    assert feed(dfpc, [visual(t) for t in times(5, 8)]) == []
    out = poses(feed(dfpc, [s for s in felt(13.0) if s.stamp_ns > T0 + 12_000 * MS]))
    assert out[-1].t1_ns == T0 + 13_000 * MS
    assert dfpc.get_trajectory(-1, -1).stamps_ns[0] == T0
    assert out[-1].quality.metrics["refused_vo"] == len(times(5, 8))


@pytest.mark.parametrize("period_s", [6, 31, 300])
def test_a_source_that_speaks_seldom_and_alone_is_taken(period_s: int) -> None:
    time, arrivals = MissionTime(PositionManagerConfig()), []
    jitter_ms = np.random.default_rng(1).integers(-2000, 2000, 60)
    for k, late_ms in enumerate(jitter_ms):
        arrivals.append(time.take(at(visual(0.0), (k * period_s * 1000 + int(late_ms)) * MS)))
    assert sum(len(a.taken) for a in arrivals) >= 58
    assert not any(a.refused or a.back for a in arrivals)


def test_a_mast_that_moves_while_the_robot_stands_does_not_let_late_vision_turn_the_clock_back() -> None:
    time = MissionTime(PositionManagerConfig())
    joints = replace(wheels(0.0), port="joints")
    parked = [*seen(0.0, 90.0), *(at(joints, t * 1000 * MS) for t in (93, 97, 101))]
    for sample in sorted(parked, key=lambda s: s.stamp_ns):
        time.take(sample)
    late = [time.take(visual(t)) for t in (70.0, 74.0, 77.0)]
    assert not any(a.taken or a.back for a in late)
    again = [time.take(s).back for s in sorted(seen(0.0, 5.0), key=lambda s: s.stamp_ns)]
    assert sum(again) == 1


def test_a_first_sample_of_the_future_does_not_decide_what_time_it_is() -> None:
    dfpc = manager()
    feed(dfpc, [at(wheels(0.0), HOUR)])
    out = poses(feed(dfpc, seen(0.0, 5.0)))
    assert out[-1].t1_ns == T0 + 5_000 * MS
    assert error_m(out[-1]) < 0.01


def test_a_restart_after_a_day_costs_no_more_than_one_after_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    before = manager()
    feed(before, seen(0.0, 4.0))
    before.pin(T0 + 2_000 * MS)
    after = manager()
    after.resume(before.state())
    steps = predictions(after, monkeypatch)
    out: list[Output] = poses(feed(after, [at(s, 24 * HOUR) for s in seen(6.0, 9.0)]))
    assert len(steps) < 2_000
    assert np.linalg.norm(out[-1].value.transform.matrix - T_SITE_ODOM @ truth(9.0)) < 0.1
    np.testing.assert_array_equal(after.get_pins().stamps_ns, [T0 + 2_000 * MS])


def test_what_is_held_of_a_clock_that_stands_still_is_bounded() -> None:
    dfpc = manager()
    feed(dfpc, seen(0.0, 2.0))
    value = TransformWithCovariance.from_transform(
        UncertainTransform(np.eye(4)), parent="mana/odom", child="mana/base", stamp_ns=T0 + HOUR
    )
    stuck = Sample("odometry", T0 + HOUR, 0, value)
    assert feed(dfpc, [stuck] * 5_000, in_order=False) == []
    assert len(dfpc._time._other) <= 4_096
    assert poses(feed(dfpc, seen(2.0, 3.0)))[-1].t1_ns == T0 + 3_000 * MS
