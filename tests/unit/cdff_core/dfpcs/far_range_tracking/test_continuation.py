# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which coasting object a new object continues, and the range error of a height that has changed."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest

from cdff_common.camera import CameraModel
from cdff_core.bearing_tracking.motion import states_at_rest
from cdff_core.dfpcs.far_range_tracking.configuration import FarRangeTrackingConfig
from cdff_core.dfpcs.far_range_tracking.continuation import coasting_predecessor
from cdff_core.dfpcs.far_range_tracking.scene import Scene
from cdff_core.dfpcs.far_range_tracking.target_range import TargetRange
from cdff_core.dfpcs.far_range_tracking.tracked_object import TrackedObject

SIGMA_RAD = 0.01
CAMERA = CameraModel(360, 640, 800.0, 800.0, 319.5, 179.5)


def tracked(angle_rad: float, number: int = 0, misses: int = 0, width_px: float = 20.0) -> TrackedObject:
    """Return an object at rest in a direction, without a region in the image."""
    direction = np.array([[np.sin(angle_rad), 0.0, np.cos(angle_rad)]])
    states = states_at_rest(direction, SIGMA_RAD**2 * np.eye(3)[None], 0.02)
    o = TrackedObject(number, states, np.array([width_px, 20.0]), direction[0], None, 0, 0)
    o.misses = misses
    return o


def predecessor(
    new: TrackedObject, old: list[TrackedObject], score: float = 1.0, **options: Any
) -> int | None:
    """Return the number of the predecessor of an object with this correlation of the appearance."""
    found = coasting_predecessor(new, old, cast(Scene, None), lambda *_: score, **options)
    return None if found is None else found.number


@pytest.mark.parametrize("is_early", [False, True])
def test_position_size_and_appearance_decide(is_early: bool) -> None:
    old = [tracked(0.0, 7, misses=5)]
    assert predecessor(tracked(0.02), old, is_early=is_early) == 7
    assert predecessor(tracked(0.12), old, is_early=is_early) is None
    assert predecessor(tracked(0.0, width_px=60.0), old, is_early=is_early) is None
    assert predecessor(tracked(0.0), old, score=-0.5, is_early=is_early) is None
    assert predecessor(tracked(0.0), [tracked(0.0, 7, misses=1)], is_early=is_early) is None


def test_before_confirmation_the_choice_must_be_unique() -> None:
    old = [tracked(0.0, 7, misses=5), tracked(0.03, 8, misses=5)]
    assert predecessor(tracked(0.005), old) == 7
    assert predecessor(tracked(0.005), old, is_early=True) is None
    assert predecessor(tracked(0.005), [old[0], tracked(0.3, 8, misses=5)], is_early=True) == 7


def test_a_height_that_differs_from_the_mean_has_a_larger_range_error() -> None:
    ranges = TargetRange(cast(Any, None), cast(Any, None), FarRangeTrackingConfig(target_height_m=1.4))

    def measured(height_px: float) -> tuple[float, float]:
        o = tracked(0.0)
        o.box, o.is_full_height = np.array([310.0, 330.0, 170.0, 170.0 + height_px]), True
        (ranging,) = ranges.measure(o, CAMERA, cast(Any, None), None, None, 1.0)
        return ranging.range_m, ranging.sigma_m

    range_m, sigma_m = measured(20.0)
    assert range_m == pytest.approx(1.4 * 800.0 / 20.0, rel=1e-3)
    assert sigma_m == pytest.approx(range_m * np.sqrt(2.0) * 0.3 / 20.0)
    range_m, sigma_m = measured(22.0)
    assert sigma_m == pytest.approx(range_m * np.sqrt(2.0) * np.hypot(0.3, 2.0) / 22.0)
