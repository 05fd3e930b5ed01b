# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gaps, repeated stamps and jumps of the clock of a stream."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_dev.logs.information import StreamReport
from cdff_dev.logs.source import StreamInfo
from cdff_dev.logs.timing import timing

SECOND_NS = 1_000_000_000


def _timing(*seconds: float) -> dict[str, float]:
    result = timing(np.round(np.array(seconds) * SECOND_NS).astype(np.int64))
    return {name: getattr(result, name) for name in result.__dataclass_fields__}


def test_a_regular_stream_has_only_a_rate() -> None:
    result = _timing(0.0, 0.1, 0.2, 0.3)
    assert result["rate_hz"] == pytest.approx(10.0)
    assert result["duration_s"] == pytest.approx(0.3)
    assert [result[n] for n in ("gaps", "repeated", "backwards", "clock_jumps")] == [0, 0, 0, 0]


def test_gaps_are_longer_than_three_periods() -> None:
    result = _timing(0.0, 0.1, 0.2, 0.5, 0.6, 0.7, 1.2, 1.3, 2.0, 2.1)
    assert result["gaps"] == 2
    assert result["longest_gap_s"] == pytest.approx(0.7)
    assert result["longest_gap_at_ns"] == 1_300_000_000


def test_repeated_and_unordered_stamps_are_counted() -> None:
    result = _timing(0.0, 1.0, 1.0, 2.0, 1.5, 3.0)
    assert (result["repeated"], result["backwards"], result["clock_jumps"]) == (1, 1, 0)


def test_the_clock_jumps_back_and_forwards() -> None:
    result = _timing(0.0, 0.1, 0.2, 5000.0, 5000.1, 5000.2, 10.0, 10.1)
    assert (result["clock_jumps"], result["backwards"]) == (2, 1)


@pytest.mark.parametrize("seconds", [(), (1.0,), (1.0, 1.0)])
def test_few_stamps_have_no_rate(seconds: tuple[float, ...]) -> None:
    assert _timing(*seconds)["rate_hz"] == 0.0


def test_samples_in_bursts_have_the_mean_rate() -> None:
    bursts_us = [second * 1_000_000 + k * 15 for second in range(10) for k in range(4)]
    result = timing(np.array(bursts_us, np.int64) * 1000)
    assert result.has_bursts
    assert result.rate_hz == pytest.approx(1e6 / 15)
    assert result.mean_rate_hz == pytest.approx(39 / 9.000045)
    assert not timing(np.arange(10, dtype=np.int64) * 10**8).has_bursts


def test_rates_below_a_tenth_of_a_hertz_are_shown_as_periods() -> None:
    info = StreamInfo("Frame", 3, 0, 7_200_000_000_000)
    hourly = timing(np.arange(3, dtype=np.int64) * 3_600_000_000_000)
    assert "1/3600 s" in StreamReport(info, hourly, "", "").text("/a/b.c")[0]
