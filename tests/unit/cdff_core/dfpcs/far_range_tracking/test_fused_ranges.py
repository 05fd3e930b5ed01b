# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The range of an object from several sources, one of which can be wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cdff_core.dfpcs.far_range_tracking.target_range import Ranging, fuse_ranges

UNKNOWN = (math.nan, math.nan)
STEREO, HEIGHT = Ranging("stereo", 40.0, 0.3, 0.0), Ranging("height", 40.6, 0.6, 0.0)
WRONG = Ranging("terrain", 33.0, 0.5, 0.0)


def test_ranges_that_agree_give_the_mean_by_variance() -> None:
    mean, reasons = fuse_ranges([STEREO, HEIGHT], UNKNOWN)
    assert mean is not None
    assert mean.source == "stereo+height"
    assert mean.range_m == pytest.approx((40.0 / 0.09 + 40.6 / 0.36) / (1.0 / 0.09 + 1.0 / 0.36))
    assert reasons == ()


@pytest.mark.parametrize("expected", [UNKNOWN, (40.0, 1.0), (33.0, 1.0)])
def test_a_range_that_contradicts_two_others_is_not_used(expected: tuple[float, float]) -> None:
    mean, reasons = fuse_ranges([WRONG, STEREO, HEIGHT], expected)
    assert mean is not None
    assert mean.source == "stereo+height"
    assert reasons == ("ranges_disagree",)


@pytest.mark.parametrize(("expected_m", "source"), [(39.0, "stereo"), (33.5, "terrain")])
def test_of_two_ranges_the_expected_one_is_used(expected_m: float, source: str) -> None:
    mean, reasons = fuse_ranges([WRONG, STEREO], (expected_m, 0.5))
    assert mean is not None
    assert mean.source == source
    assert reasons == ("ranges_disagree",)


@pytest.mark.parametrize("expected", [UNKNOWN, (50.0, 0.1), (36.5, 3.0)])
def test_without_a_decision_no_range_is_used(expected: tuple[float, float]) -> None:
    assert fuse_ranges([WRONG, STEREO], expected) == (None, ("ranges_disagree",))


def test_a_systematic_error_explains_a_difference() -> None:
    mean, reasons = fuse_ranges([Ranging("height", 33.0, 0.5, 0.1), STEREO], UNKNOWN)
    assert mean is not None
    assert reasons == ()
    assert mean.systematic * mean.range_m == pytest.approx(1.0 / np.sqrt(1.0 / 0.09 + 1.0 / (0.25 + 3.3**2)))
