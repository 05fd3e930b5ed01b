# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replies to standing requests follow the times of capture."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from services.orchestrator.pacing import Pacing

S = 1_000_000_000


def replies(pacing: Pacing, arrivals: Iterable[tuple[float, float]], start_s: float = 0.0) -> list[float]:
    """Return the capture times, seconds, of the products that are sent, given arrival and capture times."""
    sent = []
    newest_s = None
    for now_s, t1_s in arrivals:
        newest_s = t1_s
        if now_s >= start_s and pacing.is_due(int(newest_s * S), now_s):
            pacing.add(int(newest_s * S), now_s)
            sent.append(round(newest_s, 3))
    return sent


def test_a_product_made_once_a_period_is_sent_when_it_arrives() -> None:
    pacing = Pacing(1.0)
    assert pacing.is_due(0, 0.9)  # the request comes 0.9 s after the last product
    pacing.add(0, 0.9)
    assert replies(pacing, [(k + 0.02, float(k)) for k in range(1, 20)]) == [float(k) for k in range(1, 20)]


def test_jitter_of_the_period_omits_no_product(rng: np.random.Generator) -> None:
    times = np.arange(1, 200) + rng.uniform(-0.04, 0.04, 199)
    pacing = Pacing(1.0)
    pacing.add(0, 0.5)
    assert len(replies(pacing, [(t + rng.uniform(0.0, 0.3), t) for t in times])) == 199


@pytest.mark.parametrize(("rate_hz", "expected"), [(10.0, 30), (3.0, 30), (0.5, 15), (1.0, 30)])
def test_of_faster_products_one_each_period_is_sent_and_of_slower_ones_all(
    rate_hz: float, expected: int
) -> None:
    pacing = Pacing(1.0)
    times = np.arange(0.0, 30.0, 1.0 / rate_hz)
    assert abs(len(replies(pacing, [(t + 0.05, t) for t in times])) - expected) <= 1


def test_capture_time_that_runs_faster_than_the_clock_sends_no_more_replies() -> None:
    pacing = Pacing(1.0)
    assert len(replies(pacing, [(t, 10.0 * t) for t in np.arange(0.0, 20.0, 0.1)])) <= 22


def test_after_a_gap_the_period_counts_from_the_next_product() -> None:
    pacing = Pacing(1.0)
    pacing.add(0, 0.0)
    arrivals = [(t + 0.01, t) for t in np.arange(7.3, 10.0, 0.1)]
    assert replies(pacing, arrivals) == pytest.approx([7.3, 8.3, 9.3], abs=0.11)


def test_a_product_is_sent_once_and_no_older_one() -> None:
    pacing = Pacing(0.5)
    pacing.add(10 * S, 0.0)
    assert not pacing.is_due(10 * S, 5.0)
    assert not pacing.is_due(9 * S, 5.0)
    assert pacing.is_due(11 * S, 5.0)
