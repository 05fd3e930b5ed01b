# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, NavigationMap
from cdff_core.dfns.traversability.footprint_plane import CAUTION, HAZARD, SAFE, UNKNOWN, FootprintPlane
from cdff_core.dfns.traversability.interface import TraversabilityInputs

GRID = GridGeometry.aligned("site", 0.1, (-5, -4, 5, 4))
X, Y = GRID.centres_m()
ROVER = {
    "length_m": 1.0,
    "width_m": 0.6,
    "max_slope_deg": 20.0,
    "max_step_m": 0.15,
    "max_roughness_m": 0.05,
    "margin_m": 0.1,
}


def rate(heights: np.ndarray, **config: Any) -> NavigationMap:
    node = FootprintPlane()
    node.configure({**ROVER, **config})
    dem = ElevationMap.from_layers(GRID, {"mean": heights.astype(np.float32)}, t0_ns=1000, t1_ns=2000)
    return node.process(TraversabilityInputs(dem=dem)).map


@pytest.mark.req("CDFF-CORE-073")
@pytest.mark.parametrize(("slope_deg", "expected"), [(5.0, SAFE), (17.0, CAUTION), (23.0, HAZARD)])
@pytest.mark.parametrize("azimuth_deg", [0.0, 70.0])
@pytest.mark.parametrize("datum_m", [0.0, -2500.0])
def test_a_plane_is_rated_by_its_slope_in_any_direction(
    slope_deg: float, expected: int, azimuth_deg: float, datum_m: float
) -> None:
    a = np.radians(azimuth_deg)
    rating = rate(datum_m + np.tan(np.radians(slope_deg)) * (np.cos(a) * X + np.sin(a) * Y), max_step_m=0.5)
    inner = (slice(10, -10), slice(10, -10))
    assert (rating.layer("class")[inner] == expected).all()
    np.testing.assert_allclose(rating.layer("slope_deg")[inner], slope_deg, atol=0.15)
    assert np.nanmax(rating.layer("roughness_m")[inner]) < 2e-4


def test_unobserved_ground_is_unknown_and_has_no_value() -> None:
    heights = np.where(X < 0, 0.0, np.nan)
    rating = rate(heights)
    unobserved = np.isnan(heights)
    assert (rating.layer("class")[unobserved] == UNKNOWN).all()
    for name in ("slope_deg", "step_m", "roughness_m", "cost"):
        assert np.isnan(rating.layer(name)[unobserved]).all(), name
    assert (rating.layer("class")[:, :30] == SAFE).mean() > 0.9


# Without the edges of the map, where too little of the footprint is observed.
CENTRAL = (np.abs(X) < 3.0) & (np.abs(Y) < 2.5)
# The centres of the outermost cells of the ledge are at 0.35 m.
LEDGE = (np.abs(X) < 0.4) & (np.abs(Y) < 0.4)


def rate_under_ledge(
    overhang_m: float, variance_m2: float = 0.0, datum_m: float = 0.0, **config: Any
) -> NavigationMap:
    """Rate flat ground with a ledge above its centre."""
    node = FootprintPlane()
    node.configure({**ROVER, **config})
    flat = np.full(X.shape, datum_m, np.float32)
    layers = {
        "mean": flat,
        "variance": np.full_like(flat, variance_m2),
        "overhang_m": np.where(LEDGE, np.float32(datum_m + overhang_m), np.float32(np.nan)),
    }
    dem = ElevationMap.from_layers(GRID, layers, t0_ns=1000, t1_ns=2000)
    return node.process(TraversabilityInputs(dem=dem)).map


@pytest.mark.req("CDFF-CORE-073")
@pytest.mark.parametrize("datum_m", [0.0, -2500.0])
def test_ground_under_a_ledge_lower_than_the_rover_is_a_hazard(
    datum_m: float,
) -> None:
    result = rate_under_ledge(1.1, datum_m=datum_m, height_m=1.5)
    classes = result.layer("class")
    distance_m = np.hypot(np.maximum(np.abs(X) - 0.35, 0.0), np.maximum(np.abs(Y) - 0.35, 0.0))
    # Half the width of the rover and the margin.
    assert (classes[distance_m < 0.38] == HAZARD).all()
    # The rover may pass but not rotate.
    assert (classes[(distance_m > 0.42) & (distance_m < 0.65)] == CAUTION).all()
    assert (classes[(distance_m > 0.8) & CENTRAL] == SAFE).all()
    assert (result.layer("cost")[LEDGE] == 1.0).all()
    assert (result.layer("confidence")[LEDGE] < 1e-6).all()


@pytest.mark.parametrize(("overhang_m", "height_m"), [(1.1, None), (1.1, 0.9), (1.7, 1.5)])
def test_a_ledge_of_sufficient_or_unknown_height_has_no_effect(
    overhang_m: float, height_m: float | None
) -> None:
    assert (rate_under_ledge(overhang_m, height_m=height_m).layer("class")[CENTRAL] == SAFE).all()


@pytest.mark.parametrize(("sigmas", "expected"), [(3.0, HAZARD), (1.0, SAFE)])
def test_the_clearance_under_a_ledge_includes_a_margin_in_standard_deviations(
    sigmas: float, expected: int
) -> None:
    result = rate_under_ledge(1.53, variance_m2=0.02**2, height_m=1.5, sigmas=sigmas)
    assert (result.layer("class")[LEDGE] == expected).all()


def test_an_observed_cell_is_unknown_if_too_little_of_the_footprint_is_observed() -> None:
    heights = np.full(GRID.shape, np.nan)
    heights[:, 50] = 0.0
    heights[40, :] = 0.0
    assert (rate(heights).layer("class") == UNKNOWN).all()
    assert (rate(np.full(GRID.shape, np.nan)).layer("class") == UNKNOWN).all()


@pytest.mark.req("CDFF-CORE-073")
def test_a_rock_is_a_hazard_within_the_half_width_and_caution_within_the_turning_radius() -> None:
    rating = rate(
        np.where((np.abs(X) < 0.15) & (np.abs(Y) < 0.15), 0.25, 0.0), max_roughness_m=1.0, max_slope_deg=60.0
    )
    classes, distance = rating.layer("class"), np.hypot(X, Y)
    assert (classes[distance < 0.15 + 0.3 + 0.1] == HAZARD).all()
    turning = 0.15 + 0.5 * np.hypot(1.0, 0.6) + 0.1
    assert (classes[distance < turning] >= CAUTION).all()
    outside = (distance > turning + 0.5) & (np.abs(X) < 4.4) & (np.abs(Y) < 3.4)
    assert (classes[outside] == SAFE).all()


def test_a_step_inside_one_cell_is_detected_completely() -> None:
    heights = np.where(X < 0, 0.0, 0.3)
    heights[:, 50] = 0.15  # the cell that contains the step has the mean of both levels
    rating = rate(heights, max_roughness_m=1.0, max_slope_deg=60.0)
    assert rating.layer("step_m")[40, 51] == pytest.approx(0.3)
    assert (rating.layer("class")[10:-10, 48:53] == HAZARD).all()


@pytest.mark.req("CDFF-CORE-073")
def test_roughness_is_the_distance_of_the_heights_from_their_plane(rng: np.random.Generator) -> None:
    rating = rate(rng.normal(0.0, 0.06, GRID.shape), max_step_m=5.0)
    inner = rating.layer("roughness_m")[10:-10, 10:-10]
    assert np.median(inner) == pytest.approx(0.06, rel=0.05)
    assert np.median(rating.layer("class")[10:-10, 10:-10]) == HAZARD


def test_the_cost_is_the_largest_ratio_of_a_value_to_its_limit() -> None:
    rating = rate(np.tan(np.radians(10.0)) * X, max_step_m=1.0)
    assert rating.layer("cost")[40, 50] == pytest.approx(0.5, abs=0.01)
    assert rating.layer("cost").dtype == np.float32
    assert rating.layer("class").dtype == np.uint8


def test_the_navigation_map_has_the_geometry_and_times_of_the_elevation_map() -> None:
    rating = rate(np.zeros(GRID.shape))
    assert (rating.geometry, rating.t0_ns, rating.t1_ns) == (GRID, 1000, 2000)


def test_a_map_without_heights_and_a_limit_out_of_bounds_are_refused() -> None:
    node = FootprintPlane()
    node.configure()
    without_heights = ElevationMap.from_layers(
        GRID, {"count": np.zeros(GRID.shape, np.float32)}, t0_ns=0, t1_ns=0
    )
    with pytest.raises(InputError, match="mean"):
        node.process(TraversabilityInputs(dem=without_heights))
    with pytest.raises(ConfigurationError, match="max_slope_deg"):
        node.configure({"max_slope_deg": 90.0})


def rate_with_noise(
    sigma_m: float, rng: np.random.Generator, base: np.ndarray | None = None, **config: Any
) -> NavigationMap:
    node = FootprintPlane()
    node.configure({**ROVER, **config})
    heights = (np.zeros(GRID.shape) if base is None else base) + rng.normal(0.0, sigma_m, GRID.shape)
    layers = {"mean": heights, "variance": np.full(GRID.shape, sigma_m**2)}
    dem = ElevationMap.from_layers(
        GRID, {k: v.astype(np.float32) for k, v in layers.items()}, t0_ns=0, t1_ns=0
    )
    return node.process(TraversabilityInputs(dem=dem)).map


INNER = (slice(10, -10), slice(10, -10))


@pytest.mark.req("CDFF-CORE-073")
def test_noise_of_the_stated_variance_is_not_classified_as_steps(rng: np.random.Generator) -> None:
    result = rate_with_noise(0.02, rng)
    assert (result.layer("class")[INNER] == SAFE).mean() > 0.97
    assert np.nanmedian(result.layer("step_m")[INNER]) < 0.03
    assert (result.layer("confidence")[INNER] > 0.99).mean() > 0.97


@pytest.mark.req("CDFF-CORE-073")
@pytest.mark.parametrize("sigma_m", [0.03, 0.06])
def test_cells_less_than_three_standard_deviations_below_a_limit_are_not_safe(
    sigma_m: float, rng: np.random.Generator
) -> None:
    block = np.where((np.abs(X) < 0.35) & (np.abs(Y) < 0.35), 0.19, 0.0)  # a step slightly above the limit
    result = rate_with_noise(sigma_m, rng, block, max_roughness_m=1.0, max_slope_deg=60.0)
    assert (result.layer("class")[np.hypot(X, Y) < 0.5] != SAFE).all()
    flat = rate_with_noise(0.5, rng, max_roughness_m=5.0, max_step_m=0.3)
    assert (flat.layer("class")[INNER] == SAFE).mean() < 0.05  # too noisy for safe cells


def test_noise_compensation_does_not_remove_rocks_near_the_limit(rng: np.random.Generator) -> None:
    missed = false_hazards = hazards = 0
    for _ in range(10):
        rocks = np.zeros(GRID.shape)
        for row, col in np.ndindex(6, 8):
            rocks[row * 12 + 8 : row * 12 + 10, col * 12 + 6 : col * 12 + 8] = rng.uniform(0.05, 0.25)
        limits = {"max_roughness_m": 1.0, "max_slope_deg": 60.0}
        result = rate_with_noise(0.03, rng, rocks, **limits).layer("class") == HAZARD
        truth = rate(rocks, **limits).layer("class") == HAZARD
        missed += int((truth & ~result).sum())
        false_hazards += int((result & ~truth).sum())
        hazards += int(truth.sum())
    assert missed < 0.08 * hazards
    assert false_hazards < 0.2 * hazards


def test_ground_next_to_a_hole_that_may_hide_a_step_is_not_safe_unless_the_hole_is_tiny() -> None:
    heights = np.zeros(GRID.shape)
    heights[38:42, 48:52] = np.nan
    heights[20, 20] = np.nan
    classes = rate(heights).layer("class")
    near = np.hypot(X, Y) < 0.55
    assert (classes[near] != SAFE).all()
    assert (classes[19:22, 19:22][np.isfinite(heights[19:22, 19:22])] == SAFE).all()
