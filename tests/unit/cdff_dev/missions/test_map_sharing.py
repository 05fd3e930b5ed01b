# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The assessment of a shared map measures the errors of the relative position and of the elevation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import UnavailableError
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import ElevationMap
from cdff_dev.missions import map_sharing
from cdff_dev.missions.map_sharing import (
    ElevationErrors,
    SharedMapErrors,
    assess_shared_map,
    elevation_errors,
)
from cdff_dev.missions.script import SharedMapLimits
from cdff_dev.missions.tracks import RelativePositionErrors

SHARING = SharedMapLimits(
    robots=("mana", "minnie"), within_m=5, max_error_m=0.1, region="bbox:0,0,2,2", resolution_m=0.5
)


def test_robots_whose_paths_are_nowhere_close_are_a_fault() -> None:
    position_errors = RelativePositionErrors(0, float("nan"), float("nan"))
    heights = ElevationErrors(1, 0.0, 0.0, 1.0)
    result = SharedMapErrors({"minnie/slam": 2}, 1, (position_errors, position_errors), (heights, heights))
    assert result.faults(SHARING) == ["the paths of the rovers are nowhere within 5 m of each other"]


def test_a_relative_position_error_above_its_limit_is_a_fault() -> None:
    heights = ElevationErrors(1, 0.0, 0.0, 1.0)
    result = SharedMapErrors(
        {"minnie/slam": 2},
        1,
        (RelativePositionErrors(9, 2.0, 3.0), RelativePositionErrors(9, 0.05, 0.12)),
        (heights, heights),
    )
    assert result.faults(SHARING) == ["relative position 0.120 m off, limit 0.1 m"]
    assert "0.120" in "\n".join(result.lines())


def test_a_shared_map_that_is_worse_than_that_of_the_better_robot_is_a_fault() -> None:
    positions = (RelativePositionErrors(9, 2.0, 3.0), RelativePositionErrors(9, 0.01, 0.02))
    good, bad, both = (ElevationErrors(9, 0.0, rms_m, 1.0) for rms_m in (0.002, 0.266, 0.11))
    separate = {"mana": good, "minnie": bad, "pooled": both}
    fused = SharedMapErrors({"minnie/slam": 2}, 1, positions, (good, good), separate)
    assert fused.faults(SHARING) == []
    assert "map of minnie alone: bias +0.000 m, RMS 0.266 m" in "\n".join(fused.lines())
    spoiled = SharedMapErrors({"minnie/slam": 2}, 1, positions, (both, good), separate)
    (fault,) = spoiled.faults(SHARING)
    assert "RMS 0.110 m" in fault
    assert "0.002 m" in fault


def test_heights_are_compared_with_the_true_cell_around_each_centre() -> None:
    true = GridGeometry("site", 0.5, 0.0, 2.0, 4, 4)
    heights = np.arange(16, dtype=np.float32).reshape(4, 4)
    map_heights = heights[1:3, 1:3] + 0.25
    map_heights[0, 0] = np.nan
    layers = {"mean": map_heights}
    errors = elevation_errors(
        ElevationMap.from_layers(GridGeometry("site", 0.5, 0.5, 1.5, 2, 2), layers, t0_ns=0, t1_ns=1000),
        ElevationMap.from_layers(true, {"mean": heights}, t0_ns=0, t1_ns=1000),
    )
    assert (errors.cells, errors.bias_m, errors.rms_m, errors.coverage) == (3, 0.25, 0.25, 0.75)


def test_the_assessment_is_repeated_while_the_dpm_has_no_poses_of_a_robot(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    position_errors, heights = RelativePositionErrors(9, 0.01, 0.02), ElevationErrors(1, 0.0, 0.0, 1.0)
    merged = SharedMapErrors({"minnie/slam": 2}, 1, (position_errors, position_errors), (heights, heights))
    results: list[Any] = [UnavailableError("the DPM holds no poses of minnie"), merged]

    def errors(*_arguments: object) -> SharedMapErrors:
        result = results.pop(0)
        if isinstance(result, Exception):
            raise result
        return result

    monkeypatch.setattr(map_sharing, "_errors", errors)
    unused: Any = None
    assert assess_shared_map(SHARING, unused, Path("log"), unused, "") is merged
