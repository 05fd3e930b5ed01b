# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison with the true terrain: surface heights, the terrain that a rover crossed, and errors of maps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import ElevationMap
from cdff_dev.missions.terrain import (
    TerrainCrossed,
    assess_crossed_terrain,
    compare_elevation,
    surface_heights_m,
)

LIMITS = {"length_m": 1.0, "width_m": 0.8, "max_slope_deg": 20.0, "max_step_m": 0.2}
BASE_M = 0.3


def box(x_m: float, y_m: float, height_m: float) -> tuple[Any, Any]:
    """Return vertices and triangles of the top of a box of 0.4 m width."""
    corners = [
        [x_m + dx, y_m + dy, height_m] for dx, dy in ((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2))
    ]
    return np.array(corners, dtype=np.float32), np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)


def plane(slope: float = 0.0, rock: tuple[float, float, float] | None = None) -> Any:
    """Return a scene of 20 m of ground that rises along x, with an optional rock."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    corners = np.array([[-10, -10], [10, -10], [10, 10], [-10, 10]], dtype=np.float32)
    vertices = np.column_stack([corners, slope * corners[:, 0]]).astype(np.float32)
    parts = [(vertices, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32))]
    if rock is not None:
        parts.append(box(*rock))
    for points, triangles in parts:
        scene.add_triangles(o3d.core.Tensor(points), o3d.core.Tensor(triangles))
    return scene


def straight(slope: float = 0.0) -> NDArray[np.float64]:
    """Return poses of a base on the slope, along 6 m of x."""
    R = se3.exp_so3([0.0, -math.atan(slope), 0.0])
    x = np.arange(-3.0, 3.0, 0.1)
    ground = np.column_stack([x, np.zeros_like(x), slope * x])
    return se3.transform(np.tile(R, (len(x), 1, 1)), ground + BASE_M * R[:, 2])


def test_the_surface_height_is_that_of_terrain_or_rock_and_nan_outside() -> None:
    heights = surface_heights_m(
        plane(0.1, (2.0, 0.0, 0.9)), np.array([[1.0, 0, 5], [2, 0, 5], [2, 1, 5], [30, 0, 5]])
    )
    assert heights[:3] == pytest.approx([0.1, 0.9, 0.2], abs=1e-5)
    assert np.isnan(heights[3])


@pytest.mark.req("CDFF-DEV-074")
@pytest.mark.parametrize(("slope_deg", "too_steep"), [(10.0, False), (24.0, True)])
def test_the_slope_under_a_rover_is_computed(slope_deg: float, too_steep: bool) -> None:
    slope = math.tan(math.radians(slope_deg))
    crossed = assess_crossed_terrain("mana", straight(slope), plane(slope), BASE_M, LIMITS)
    assert crossed.steepest_deg == pytest.approx(slope_deg, abs=0.01)
    assert crossed.highest_m == pytest.approx(0.0, abs=1e-4)
    assert crossed.places == pytest.approx(5.9 / math.cos(math.radians(slope_deg)) / 0.2, abs=1.1)
    assert crossed.too_steep == (crossed.places if too_steep else 0)


@pytest.mark.req("CDFF-DEV-074")
def test_only_a_rock_on_the_path_is_reported() -> None:
    with_rock_on_path = assess_crossed_terrain(
        "mana", straight(), plane(rock=(1.0, 0.3, 0.5)), BASE_M, LIMITS
    )
    assert with_rock_on_path.highest_m == pytest.approx(0.5, abs=1e-4)
    assert 3 <= with_rock_on_path.too_high <= 8
    assert "an obstacle of 0.50 m" in with_rock_on_path.faults(5.0, 0.1)[0]
    without_contact = assess_crossed_terrain("mana", straight(), plane(rock=(1.0, 0.7, 0.5)), BASE_M, LIMITS)
    assert (without_contact.too_high, without_contact.faults(5.0, 0.1)) == (0, [])


def test_a_limit_is_violated_only_beyond_its_tolerance() -> None:
    assert TerrainCrossed("mana", 9, 24.9, 0.29, 1, 1, 20.0, 0.2).faults(5.0, 0.1) == []
    assert len(TerrainCrossed("mana", 9, 25.1, 0.31, 1, 1, 20.0, 0.2).faults(5.0, 0.1)) == 2


@pytest.mark.req("CDFF-DEV-074")
@pytest.mark.parametrize("bias_m", [0.0, 0.07])
def test_map_errors_are_computed_from_the_terrain(bias_m: float, rng: np.random.Generator) -> None:
    T_site_world = se3.transform(se3.exp_so3([0.0, 0.0, 0.4]), [3.0, -2.0, 1.5])
    geometry = GridGeometry("site", 0.5, 0.0, 4.0, 16, 16)
    x, y = geometry.centres_m()
    centres_world = se3.transform_points(
        se3.inverse(T_site_world), np.stack([x, y, 0 * x], -1).reshape(-1, 3)
    )
    heights = (0.2 * centres_world[:, 0] + 1.5 + bias_m).reshape(16, 16) + 0.02 * rng.standard_normal(
        (16, 16)
    )
    heights[:4] = np.nan
    dem = ElevationMap.from_layers(geometry, {"mean": heights.astype(np.float32)}, t0_ns=0, t1_ns=1000)
    errors = compare_elevation([dem], T_site_world, plane(0.2))
    assert errors.cells == 12 * 16
    assert errors.bias_m == pytest.approx(bias_m, abs=5e-3)
    assert errors.rms_m == pytest.approx(math.hypot(bias_m, 0.02), abs=5e-3)
    assert errors.nmad_m == pytest.approx(0.02, abs=5e-3)


def test_without_maps_no_cells_are_compared() -> None:
    errors = compare_elevation([], np.eye(4), plane())
    assert errors.cells == 0
    assert np.isnan(errors.rms_m)
