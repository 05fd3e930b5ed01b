# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The judge of a shared map measures what one robot's place is off as seen from the other."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import ElevationMap
from cdff_dev.demo.script import Sharing
from cdff_dev.demo.sharing import Heights, Seen, Shared, height_errors, relative_errors

SHARING = Sharing(robots=("mana", "minnie"), within_m=5, at_most_m=0.1, region="bbox:0,0,2,2", resolution_m=0.5)


def way(y_m: float, moved: FloatArray | None = None) -> dict[int, FloatArray]:
    poses = {i * 1000: se3.transform(np.eye(3), [float(i), y_m, 0.0]) for i in range(8)}
    return poses if moved is None else {t: moved @ T for t, T in poses.items()}


def test_moving_both_robots_alike_changes_nothing() -> None:
    moved = se3.exp_se3([3.0, 1.0, 0.5, 0.1, 0.2, 1.0])
    seen = relative_errors([way(0, moved), way(2, moved)], [way(0), way(2)], 5.0)
    assert seen.largest_m == pytest.approx(0.0, abs=1e-9)


def test_a_shift_of_one_robot_is_the_error_of_all_its_places_within_reach() -> None:
    shift = se3.transform(np.eye(3), [0.3, 0.0, 0.4])
    seen = relative_errors([way(0), way(2, shift)], [way(0), way(2)], 5.0)
    assert seen.rms_m == pytest.approx(0.5)
    assert seen.pairs == sum(abs(i - j) <= np.sqrt(21) for i in range(8) for j in range(8))


def test_robots_that_never_meet_are_a_fault() -> None:
    seen = relative_errors([way(0), way(50)], [way(0), way(50)], 5.0)
    heights = Heights(1, 0.0, 0.0, 1.0)
    found = Shared({"minnie/slam": 2}, 1, (seen, seen), (heights, heights))
    assert found.faults(SHARING) == ["the rovers were never within 5 m of one another's way"]


def test_an_error_above_the_bound_is_a_fault() -> None:
    heights = Heights(1, 0.0, 0.0, 1.0)
    found = Shared({"minnie/slam": 2}, 1, (Seen(9, 2.0, 3.0), Seen(9, 0.05, 0.12)), (heights, heights))
    assert found.faults(SHARING) == ["0.120 m off, expected at most 0.1 m"]
    assert "0.120" in "\n".join(found.lines())


def test_heights_are_compared_with_the_true_cell_around_each_centre() -> None:
    true = GridGeometry("site", 0.5, 0.0, 2.0, 4, 4)
    heights = np.arange(16, dtype=np.float32).reshape(4, 4)
    part = heights[1:3, 1:3] + 0.25
    part[0, 0] = np.nan
    layers = {"mean": part}
    found = height_errors(
        ElevationMap.from_layers(GridGeometry("site", 0.5, 0.5, 1.5, 2, 2), layers, t0_ns=0, t1_ns=1000),
        ElevationMap.from_layers(true, {"mean": heights}, t0_ns=0, t1_ns=1000),
    )
    assert (found.cells, found.bias_m, found.rms_m, found.coverage) == (3, 0.25, 0.25, 0.75)
