# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_core.dfns.terrain_ray_intersection.height_grid_march import HeightGridMarch
from cdff_core.dfns.terrain_ray_intersection.interface import (
    TerrainRayIntersectionInputs,
    TerrainRayIntersectionOutputs,
)

#: Flat ground of 100 x 100 m with a wall of 5 m from x = 30 m.
HEIGHTS = np.zeros((200, 200))
HEIGHTS[:, 160:] = 5.0


def intersected(
    target: list[float], heights: np.ndarray = HEIGHTS, sigma: float = 1e-3, height_sigma: float = 0.0
) -> TerrainRayIntersectionOutputs:
    node = HeightGridMarch()
    node.configure()
    origin = np.array([0.0, 0.0, 2.0])
    u = np.array(target) - origin
    return node.process(
        TerrainRayIntersectionInputs(
            heights=heights,
            variances=np.full(heights.shape, height_sigma**2),
            corner=np.array([-50.0, 50.0]),
            resolution=0.5,
            origin=origin,
            directions=(u / np.linalg.norm(u))[None],
            elevation_sigmas=np.array([sigma]),
        )
    )


def test_the_range_of_flat_ground_and_its_standard_deviation_are_those_of_the_triangle() -> None:
    result = intersected([20.0, 5.0, 0.0])
    r = float(np.linalg.norm([20.0, 5.0, 2.0]))
    assert result.ranges[0] == pytest.approx(r, rel=1e-6)
    # d r / d elevation = r / tan(depression).
    slope = r * np.hypot(20.0, 5.0) / 2.0
    assert result.sigmas[0] == pytest.approx(slope * 1e-3, rel=0.02)
    raised = intersected([20.0, 5.0, 0.0], height_sigma=0.1)
    assert raised.sigmas[0] == pytest.approx(np.hypot(slope * 1e-3, slope * 0.1 / r), rel=0.03)


def test_a_wall_hides_the_ground_behind_it() -> None:
    assert intersected([45.0, 0.0, 0.0]).ranges[0] == pytest.approx(30.0, abs=0.6)


def test_above_the_horizon_and_beyond_unknown_cells_there_is_no_range() -> None:
    assert np.isnan(intersected([-20.0, 0.0, 3.0]).ranges[0])
    unknown = HEIGHTS.copy()
    unknown[:, 100:140] = np.nan
    assert np.isnan(intersected([15.0, 0.0, 0.0], unknown).ranges[0])
    # The highest direction misses the ground: the range is not bounded.
    assert intersected([-40.0, 0.0, 0.0], sigma=0.1).sigmas[0] > 100.0
