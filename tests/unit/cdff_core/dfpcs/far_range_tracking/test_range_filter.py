# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Filter of the range of one object."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.dfpcs.far_range_tracking.range_filter import RangeFilter

S = 1_000_000_000


def filter_of(range_m: float, count: int) -> RangeFilter:
    """Return a filter after ``count`` measurements of a constant range, one each second."""
    result = RangeFilter()
    for k in range(count):
        result.update(k * S, range_m, 0.01 * range_m, 0.01)
    return result


def test_the_range_is_that_of_the_measurements_with_a_smaller_error() -> None:
    range_m, sigma_m = filter_of(40.0, 20).value
    assert range_m == pytest.approx(40.0, abs=1e-6)
    assert 0.01 * 40.0 < sigma_m < np.hypot(0.01, 0.01) * 40.0


def test_while_the_object_is_hidden_the_error_includes_a_change_of_its_motion() -> None:
    filtered = filter_of(40.0, 20)
    filtered.predict(39 * S)
    range_m, sigma_m = filtered.value
    assert range_m == pytest.approx(40.0, abs=1e-6)
    # 20 s of a rate with a standard deviation of 0.005/s and a time constant of 20 s.
    assert 0.04 * 40.0 < sigma_m < 0.1 * 40.0


def test_a_measurement_that_contradicts_the_range_is_not_used_and_the_fifth_replaces_it() -> None:
    filtered = filter_of(40.0, 20)
    ranges = []
    for k in range(20, 26):
        filtered.update(k * S, 25.0, 0.25, 0.01)
        ranges.append(filtered.value[0])
    assert ranges == pytest.approx([40.0, 40.0, 40.0, 40.0, 25.0, 25.0], rel=1e-3)


def test_a_contradiction_that_does_not_last_is_forgotten() -> None:
    filtered = filter_of(40.0, 20)
    for k in range(20, 40):
        filtered.update(k * S, 25.0 if k % 4 else 40.0, 0.4, 0.01)
    assert filtered.value[0] == pytest.approx(40.0, rel=1e-3)


def test_without_a_measurement_there_is_no_range() -> None:
    filtered = RangeFilter()
    filtered.predict(S)
    assert np.isnan(filtered.value).all()
