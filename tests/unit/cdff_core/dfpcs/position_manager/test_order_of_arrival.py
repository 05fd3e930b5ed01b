# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Samples that come late or in any order, through the runner of host and replay."""

from __future__ import annotations

import numpy as np

from cdff_core.runtime import Runner
from tests.unit.cdff_core.dfpcs.position_manager.test_mission_time import HOUR, at, seen
from tests.unit.cdff_core.dfpcs.position_manager.test_position_manager import MS, T0, manager


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
