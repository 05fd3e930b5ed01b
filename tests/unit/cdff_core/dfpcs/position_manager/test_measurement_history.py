# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Late samples and samples in any order, processed through the runner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError
from cdff_core.dfpcs.position_manager.measurement import Measurement, MeasurementResult
from cdff_core.dfpcs.position_manager.measurement_history import MeasurementHistory
from cdff_core.runtime import Runner
from tests.support.position_manager_samples import (
    HOUR_NS,
    MS,
    T0,
    delayed,
    feed,
    manager,
    times,
    visual,
    wheels,
    wheels_imu_and_vision,
)


@dataclass(frozen=True)
class Steps:
    """Estimate double: the sources and times that were processed, in order."""

    stamp_ns: int
    steps: tuple[tuple[int, str], ...] = ()


class EstimatorDouble:
    def __init__(self) -> None:
        self.updates = 0

    def update(self, estimate: Steps, measurement: Measurement) -> tuple[Steps, MeasurementResult]:
        self.updates += 1
        step = (measurement.stamp_ns, measurement.source)
        return Steps(step[0], (*estimate.steps, step)), MeasurementResult(True, (measurement.source,))

    def extrapolate(self, estimate: Steps, stamp_ns: int) -> Steps:
        return Steps(stamp_ns, estimate.steps)


class TimelineDouble:
    def __init__(self) -> None:
        self.stamps: list[int] = []

    def append(self, estimate: Steps) -> None:
        self.stamps.append(estimate.stamp_ns)

    def remove_after(self, stamp_ns: int) -> None:
        self.stamps = [s for s in self.stamps if s <= stamp_ns]


def history(memory_ns: int = 1000) -> tuple[MeasurementHistory, EstimatorDouble, TimelineDouble]:
    estimator, timeline = EstimatorDouble(), TimelineDouble()
    result = MeasurementHistory(estimator, timeline, memory_ns)  # type: ignore[arg-type]  # doubles
    assert not result.is_started
    result.start(Steps(0))  # type: ignore[arg-type]  # double
    return result, estimator, timeline


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4), (4, 3, 2, 1, 0), (2, 0, 4, 1, 3)])
def test_measurements_are_processed_in_order_of_time_and_source(order: tuple[int, ...]) -> None:
    sorted_steps = [(10, "fix"), (20, "fix"), (20, "imu"), (20, "odometry"), (30, "fix")]
    past, _, timeline = history()
    for index in order:
        result = past.insert(Measurement(*sorted_steps[index]))
        assert result.reasons == (sorted_steps[index][1],)
    assert past.newest.steps == tuple(sorted_steps)  # type: ignore[attr-defined]  # double
    assert timeline.stamps == [0, 10, 20, 20, 20, 30]


def test_estimates_after_a_late_imu_reading_are_computed_again_once_and_only_those() -> None:
    past, estimator, _ = history()
    for stamp_ns in (10, 20, 30, 40):
        past.insert(Measurement(stamp_ns, "fix"))
    updates = estimator.updates
    past.invalidate(40)
    assert past.newest.stamp_ns == 40
    assert estimator.updates == updates, "no estimate is later than the reading"
    past.invalidate(35)
    past.invalidate(15)
    past.invalidate(25)
    assert past.newest.stamp_ns == 40
    assert past.newest.stamp_ns == 40
    assert estimator.updates == updates + 3


def test_an_estimate_is_extrapolated_only_after_the_newest_one_and_up_to_the_limit() -> None:
    past, _, _ = history()
    past.insert(Measurement(10, "fix"))
    assert past.extrapolate(10, 5) is None
    assert past.extrapolate(16, 5) is None
    assert [past.extrapolate(t, 5).stamp_ns for t in (11, 15)] == [11, 15]  # type: ignore[union-attr]


def test_measurements_older_than_the_memory_are_removed_in_blocks() -> None:
    past, _, _ = history(memory_ns=100)
    for stamp_ns in range(1, 165):
        past.insert(Measurement(stamp_ns, "fix"))
        assert past.oldest.stamp_ns == 0
    past.insert(Measurement(165, "fix"))
    past.insert(Measurement(166, "fix"))
    assert past.oldest.stamp_ns == 65
    assert [s for s, _ in past.newest.steps] == list(range(1, 167))  # type: ignore[attr-defined]


def test_samples_of_one_source_in_swapped_order_are_all_processed() -> None:
    """The runner is that of the host and of the replay; samples are processed in the order of arrival."""
    samples = sorted(wheels_imu_and_vision(0.0, 6.0), key=lambda s: (s.stamp_ns, s.port))
    in_swapped_order = [s for s in samples if s.port != "visual_odometry"]
    vision = [s for s in samples if s.port == "visual_odometry"]
    for earlier, later in zip(vision[::2], vision[1::2], strict=False):
        after = next(i for i, s in enumerate(in_swapped_order) if s.stamp_ns > later.stamp_ns)
        in_swapped_order[after:after] = [later, earlier]
    results = []
    for order in (samples, in_swapped_order):
        dfpc = manager()
        runner = Runner(dfpc)
        for sample in order:
            assert runner.push(sample) or sample.port == "visual_odometry"
            list(runner.drain())
        results.append(dfpc.get_pose("site", "mana/base", T0 + 5_900 * MS).transform)
        late = runner.counters.late
    assert late == 0
    np.testing.assert_allclose(results[0].matrix, results[1].matrix, atol=1e-9)
    np.testing.assert_allclose(results[0].covariance, results[1].covariance, rtol=1e-6, atol=1e-12)


def test_a_mission_clock_that_jumps_back_restarts_the_timeline_through_the_runner() -> None:
    dfpc = manager()
    runner = Runner(dfpc)
    products = []
    samples = sorted(wheels_imu_and_vision(0.0, 4.0), key=lambda s: (s.stamp_ns, s.port))
    for sample in [*samples, *(delayed(s, -HOUR_NS) for s in samples)]:
        runner.push(sample)
        products += list(runner.drain())
    assert products[-1].header.t1_ns == T0 - HOUR_NS + 4_000 * MS


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"timeline": {"dense_s": 10.0}}, r"dense_s=10 is less than memory_s=20.*increase dense_s"),
        (
            {"timeline": {"imu_period_s": 40.0}},
            r"imu_period_s=40 is more than clock.max_silence_s=30.*increase",
        ),
    ],
)
def test_inconsistent_intervals_are_refused(parameters: dict[str, dict[str, float]], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        manager(**parameters)


def test_estimates_within_the_memory_are_not_thinned() -> None:
    dfpc = manager(
        timeline={"memory_s": 2.5, "dense_s": 2.5, "thin_s": 10.0}, publication={"trajectory_period_s": 1.0}
    )
    feed(dfpc, [visual(t) for t in times(1, 12)])
    feed(dfpc, [wheels(9.6)])
    stamps = (dfpc.get_trajectory(-1, -1).stamps_ns - T0) // MS
    assert {9_000, 9_600, 10_000} <= set(stamps.tolist())
