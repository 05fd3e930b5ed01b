# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gaps, repeated stamps and jumps of the clock of a stream."""

from __future__ import annotations

import numpy as np
import pytest

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
