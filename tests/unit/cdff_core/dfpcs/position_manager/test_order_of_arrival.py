# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Samples that come late or in any order, through the runner of host and replay."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError
from cdff_core.runtime import Runner
from tests.unit.cdff_core.dfpcs.position_manager.test_mission_time import HOUR, at, seen
from tests.unit.cdff_core.dfpcs.position_manager.test_position_manager import (
    MS,
    T0,
    feed,
    manager,
    times,
    visual,
    wheels,
)


def test_samples_of_one_source_that_overtake_each_other_on_the_bus_are_all_taken() -> None:
    """As a host and a replay hand them over: through the runner, stepped as they come."""
    samples = sorted(seen(0.0, 6.0), key=lambda s: (s.stamp_ns, s.port))
    swapped = [s for s in samples if s.port != "visual_odometry"]
    vision = [s for s in samples if s.port == "visual_odometry"]
    for earlier, later in zip(vision[::2], vision[1::2], strict=False):
        after = next(i for i, s in enumerate(swapped) if s.stamp_ns > later.stamp_ns)
        swapped[after:after] = [later, earlier]
    found = []
    for order in (samples, swapped):
        dfpc = manager()
        runner = Runner(dfpc)
        for sample in order:
            assert runner.push(sample) or sample.port == "visual_odometry"
            list(runner.drain())
        found.append(dfpc.get_pose("site", "mana/base", T0 + 5_900 * MS).transform)
        late = runner.counters.late
    assert late == 0
    np.testing.assert_allclose(found[0].matrix, found[1].matrix, atol=1e-9)
    np.testing.assert_allclose(found[0].covariance, found[1].covariance, rtol=1e-6, atol=1e-12)


def test_a_mission_clock_that_went_back_begins_anew_behind_the_runner_too() -> None:
    dfpc = manager()
    runner = Runner(dfpc)
    products = []
    samples = sorted(seen(0.0, 4.0), key=lambda s: (s.stamp_ns, s.port))
    for sample in [*samples, *(at(s, -HOUR) for s in samples)]:
        runner.push(sample)
        products += list(runner.drain())
    assert products[-1].header.t1_ns == T0 - HOUR + 4_000 * MS


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"dense_s": 10.0}, r"dense_s=10 is less than memory_s=20.*make dense_s the larger"),
        ({"imu_period_s": 40.0}, r"imu_period_s=40 is more than blind_s=30.*make blind_s the larger"),
    ],
)
def test_a_time_line_that_is_thinned_where_late_measurements_reach_is_refused(
    parameters: dict[str, float], message: str
) -> None:
    with pytest.raises(ConfigurationError, match=message):
        manager(**parameters)


def test_the_estimate_from_which_a_late_measurement_is_taken_was_not_thinned() -> None:
    dfpc = manager(memory_s=2.5, dense_s=2.5, thin_s=10.0, trajectory_period_s=1.0)
    feed(dfpc, [visual(t) for t in times(1, 12)])
    feed(dfpc, [wheels(9.6)])
    stamps = (dfpc.get_trajectory(-1, -1).stamps_ns - T0) // MS
    assert {9_000, 9_600, 10_000} <= set(stamps.tolist())
