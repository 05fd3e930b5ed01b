# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated views of a satellite: the smallest ones show light, and the evaluation ends if none do."""

from __future__ import annotations

import pytest

from cdff_common.errors import InputError
from evaluation.scenes import resolved_targets


def test_the_smallest_satellite_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resolved_targets, "_VIEWS", 2)
    monkeypatch.setattr(resolved_targets, "_EXTENTS_PX", (20.0,))
    assert resolved_targets.simulated_ranges(1, lambda _: None)["20_px"]["images"] == 2


def test_views_without_light_end_with_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resolved_targets, "_VIEWS", 1)
    monkeypatch.setattr(resolved_targets, "_EXTENTS_PX", (0.01,))
    with pytest.raises(InputError, match=r"satellite of 0\.01 pixels: light in 0 of 20 views"):
        resolved_targets.simulated_ranges(1, lambda _: None)
