# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Late samples and samples in any order, processed through the runner."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError
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
