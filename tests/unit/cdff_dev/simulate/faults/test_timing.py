# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Clock errors move stamps, and lost samples are missing, by the stated amounts."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from cdff_dev.simulate.faults.timing import Clock, stamps

T_US = np.arange(20_000, dtype=np.int64) * 10_000


def test_offset_drift_and_jitter_move_the_stamps(rng: np.random.Generator) -> None:
    stamped, arrives = stamps(Clock(offset_s=0.05, drift_ppm=200.0), T_US, rng)
    assert arrives.all()
    assert stamped[0] == 50_000
    assert stamped[-1] - T_US[-1] == pytest.approx(50_000 + 200e-6 * T_US[-1], abs=1)
    jittered, _ = stamps(Clock(jitter_s=0.001), T_US, rng)
    assert (jittered - T_US).std() == pytest.approx(1000.0, rel=0.05)


def test_stamps_stay_in_order_whatever_the_jitter(rng: np.random.Generator) -> None:
    stamped, _ = stamps(Clock(jitter_s=0.05), T_US, rng)
    assert np.all(np.diff(stamped) > 0)


@pytest.mark.parametrize("burst", [1.0, 8.0])
def test_the_stated_fraction_is_lost_in_bursts_of_the_stated_length(
    burst: float, rng: np.random.Generator
) -> None:
    _, arrives = stamps(Clock(loss=0.2, burst=burst), T_US, rng)
    assert np.mean(~arrives) == pytest.approx(0.2, abs=0.025)
    starts = np.flatnonzero(arrives[:-1] & ~arrives[1:])
    assert np.sum(~arrives) / len(starts) == pytest.approx(burst, rel=0.15)


def test_a_loss_that_bursts_cannot_produce_is_refused() -> None:
    with pytest.raises(ValidationError, match="longer bursts"):
        Clock(loss=0.8, burst=1.0)
