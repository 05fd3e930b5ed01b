# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Slope, roughness, visibility, contours and area statistics on ground that is known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.raster import GridGeometry
from cdff_common.raster.area_statistics import height_statistics
from cdff_common.raster.contours import contours
from cdff_common.raster.rendering import contour_cells
from cdff_common.raster.surface import local_surface, side_cells
from cdff_common.raster.viewshed import viewshed

GRID = GridGeometry("site", 0.1, -10.0, 10.0, 200, 200)
X, Y = GRID.centres_m()
INNER = (slice(8, -8), slice(8, -8))


def noise(sigma_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return normally distributed errors of heights and their variance."""
    errors = np.random.default_rng(3).normal(0.0, sigma_m, GRID.shape)
    return errors, np.full(GRID.shape, sigma_m**2)


@pytest.mark.parametrize("side", [3, 5, 9])
def test_the_error_of_a_slope_is_the_stated_one(side: int) -> None:
    errors, variance = noise(0.01)
    s = local_surface(0.2 * X + 0.1 * Y + errors, variance, 0.1, side)
    slope = np.arctan(np.hypot(0.2, 0.1))
    ratio = (s.slope_rad[INNER] - slope) / s.sigma_slope_rad[INNER]
    assert ratio.std() == pytest.approx(1.0, abs=0.06)
    downhill = np.arctan2(-0.2, -0.1) % (2 * np.pi)
    assert s.aspect_rad[INNER].mean() == pytest.approx(downhill, abs=0.02)


#: Corners of grids at the origin of a frame and in UTM coordinates, metres.
CORNERS = [(0.0, 0.0), (412_000.0, 5_318_000.0)]


@pytest.mark.parametrize("azimuth_deg", [0, 45, 90, 135, 180, 215, 270, 359])
@pytest.mark.parametrize(("cell_m", "slope_deg"), [(0.05, 40.0), (1.0, 15.0), (20.0, 2.0)])
@pytest.mark.parametrize("corner_m", CORNERS)
def test_the_slope_and_aspect_of_a_plane_are_the_analytic_ones(
    azimuth_deg: float, cell_m: float, slope_deg: float, corner_m: tuple[float, float]
) -> None:
    x, y = GridGeometry("site", cell_m, *corner_m, 9, 7).centres_m()
    azimuth = np.radians(azimuth_deg)
    z = -np.tan(np.radians(slope_deg)) * (np.sin(azimuth) * x + np.cos(azimuth) * y)
    z[4, 3] = np.nan
    surface = local_surface(z, np.full(z.shape, 0.01**2), cell_m)
    inner = np.isfinite(z)
    inner[[0, -1]] = inner[:, [0, -1]] = False
    assert np.degrees(surface.slope_rad[inner]) == pytest.approx(slope_deg, abs=1e-4)
    turned = (np.degrees(surface.aspect_rad[inner]) - azimuth_deg + 180.0) % 360.0 - 180.0
    assert turned == pytest.approx(0.0, abs=1e-4)
    assert surface.roughness_m[inner] == pytest.approx(0.0, abs=1e-6)
    # 9 cells: the variance of each derivative is that of a height over 6 squared cells.
    expected = 0.01 / (np.sqrt(6.0) * cell_m) * np.cos(np.radians(slope_deg)) ** 2
    assert surface.sigma_slope_rad[2, 2:5] == pytest.approx(expected, rel=1e-6)
    assert np.isnan(surface.slope_rad[4, 3])
    assert np.isnan(surface.aspect_rad[0, 0])  # 4 of 9 cells


def test_level_ground_has_no_aspect() -> None:
    s = local_surface(np.full((5, 5), 123.4), np.zeros((5, 5)), 0.1)
    assert s.slope_rad[2, 2] == 0.0
    assert np.isnan(s.aspect_rad).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 20), (20, 1), (2, 2)])
@pytest.mark.parametrize("corner_m", CORNERS)
def test_maps_that_are_too_narrow_for_planes_and_lines_have_visibility_and_statistics(
    shape: tuple[int, int], corner_m: tuple[float, float]
) -> None:
    geometry = GridGeometry("site", 0.5, *corner_m, *shape)
    z = 0.1 * np.arange(np.prod(shape), dtype=np.float64).reshape(shape)
    variance = np.full(shape, 1e-4)
    s = local_surface(z, variance, 0.5)
    for values in (s.slope_rad, s.sigma_slope_rad, s.aspect_rad, s.roughness_m):
        assert values.shape == shape
        assert np.isnan(values).all()
    if 1 in shape:
        assert list(contours(geometry, z, 0.25)) == []
    for observer in ((geometry.xmin_m, geometry.ymax_m), (geometry.xmax_m, geometry.ymin_m)):
        v = viewshed(geometry, z, np.full(shape, np.nan), observer, observer_height_m=1.0)
        assert (v.visible == 1.0).all()
    result = height_statistics(z.ravel(), variance.ravel(), variance.ravel(), 0.5, None)
    assert result["area_m2"] == pytest.approx(z.size * 0.25)
    assert result["height_m"]["max"] == pytest.approx(z.max())


def test_roughness_is_that_of_the_ground_without_the_noise_of_the_measurement() -> None:
    errors, variance = noise(0.01)
    rough = np.random.default_rng(4).normal(0.0, 0.03, GRID.shape)
    s = local_surface(0.3 * X + rough + errors, variance, 0.1, 7)
    assert np.sqrt(np.mean(s.roughness_m[INNER] ** 2)) == pytest.approx(0.03, rel=0.05)
    unknown = local_surface(0.3 * X + rough + errors, np.full(GRID.shape, np.nan), 0.1, 7)
    assert np.sqrt(np.mean(unknown.roughness_m[INNER] ** 2)) == pytest.approx(np.hypot(0.03, 0.01), rel=0.05)
    assert np.isnan(unknown.sigma_slope_rad).all()


def test_a_slope_needs_half_of_its_cells() -> None:
    z = 0.2 * X
    z[:, ::2] = np.nan
    surface = local_surface(z, np.zeros(GRID.shape), 0.1, 3)
    assert np.isnan(surface.slope_rad).all()
    z = 0.2 * X
    z[100, 100] = np.nan
    surface = local_surface(z, np.zeros(GRID.shape), 0.1, 3)
    assert surface.slope_rad[100, 101] == pytest.approx(np.arctan(0.2))
    assert np.isnan(surface.slope_rad[100, 100])


def test_baselines_are_odd_numbers_of_cells_with_a_limit() -> None:
    assert [side_cells(b, 0.1) for b in (None, 0.05, 0.3, 0.5, 0.52, 1.1)] == [3, 3, 3, 5, 5, 11]
    with pytest.raises(InputError, match="at most 61"):
        side_cells(10.0, 0.1)
    with pytest.raises(InputError, match="smaller baseline_m"):
        local_surface(np.zeros((2000, 2000)), np.zeros((2000, 2000)), 0.1, 31)


def visible_by_sampling(z: np.ndarray, row: int, col: int, eye_m: float) -> np.ndarray:
    """Return the visible cells, computed by dense bilinear sampling of each line of sight."""
    from scipy.ndimage import map_coordinates

    result = np.zeros(z.shape, dtype=bool)
    top = z[row, col] + eye_m
    for r in range(z.shape[0]):
        for c in range(z.shape[1]):
            t = np.linspace(0.02, 0.98, 200)
            line = map_coordinates(z, [row + (r - row) * t, col + (c - col) * t], order=1, mode="nearest")
            result[r, c] = np.all(line <= top + (z[r, c] - top) * t + 1e-9)
    return result


def test_a_viewshed_is_that_of_densely_sampled_lines_of_sight() -> None:
    part = GridGeometry("site", 0.1, -3.0, 3.0, 60, 60)
    x, y = part.centres_m()
    z = 0.4 * np.sin(2.0 * x) * np.cos(1.5 * y) + 0.1 * x
    v = viewshed(part, z, np.full(z.shape, np.nan), (0.05, -0.05), observer_height_m=0.3)
    row, col = 30, 30
    assert v.visible[row, col] == 1.0
    expected = visible_by_sampling(z, row, col, 0.3)
    # Cells within 5 mm of the limit depend on the interpolation.
    clear = v.hidden_m > 0.005
    assert not (expected & clear).any()
    assert ((v.visible == 1.0) == expected).mean() > 0.97


def hidden_by_brute_force(z: np.ndarray, row: int, col: int, eye_m: float) -> np.ndarray:
    """Return the hidden heights, from the height of the ground where lines of sight cross rows or columns."""
    result = np.zeros(z.shape)
    top = z[row, col] + eye_m
    for r, c in np.ndindex(*z.shape):
        steps = max(abs(r - row), abs(c - col))
        required = -np.inf
        for k in range(1, steps):
            at_r, at_c = row + (r - row) * k / steps, col + (c - col) * k / steps
            r0, c0 = int(at_r), int(at_c)
            r1, c1 = int(np.ceil(at_r)), int(np.ceil(at_c))
            ground = z[r0, c0] + (z[r1, c1] - z[r0, c0]) * max(at_r - r0, at_c - c0)
            required = max(required, top + (ground - top) * steps / k)
        result[r, c] = max(required - z[r, c], 0.0)
    return result


@pytest.mark.parametrize("corner_m", CORNERS)
@pytest.mark.parametrize(("row", "col"), [(0, 0), (5, 7), (11, 14), (11, 0), (3, 14)])
def test_a_viewshed_on_random_ground_is_that_of_single_lines_of_sight(
    corner_m: tuple[float, float], row: int, col: int
) -> None:
    part = GridGeometry("site", 0.25, *corner_m, 12, 15)
    z = np.random.default_rng(5).normal(0.0, 0.5, part.shape)
    observer = float(part.x_centres_m()[col]), float(part.y_centres_m()[row])
    v = viewshed(part, z, np.full(z.shape, np.nan), observer, observer_height_m=0.7, target_height_m=0.2)
    expected = hidden_by_brute_force(z, row, col, 0.7)
    assert v.hidden_m == pytest.approx(expected, abs=1e-9)
    assert np.array_equal(v.visible == 1.0, expected <= 0.2)
    assert 0.1 < v.visible.mean() < 0.9


def test_an_observer_on_an_edge_stands_on_the_observed_cell() -> None:
    part = GridGeometry("site", 0.1, 0.0, 1.0, 10, 10)
    z = np.zeros(part.shape)
    z[:, 3] = np.nan
    for x, y in ((1.0, 0.5), (0.5, 1.0), (1.0, 1.0), (0.0, 0.0), (0.4, 0.5), (0.3, 0.5)):
        v = viewshed(part, z, np.full(z.shape, np.nan), (x, y), observer_height_m=1.0)
        assert np.nanmin(v.visible) == 1.0
    for x, y in ((1.01, 0.5), (0.5, 1.01), (0.5, -0.01), (0.35, 0.5)):
        with pytest.raises(InputError, match="unobserved; choose"):
            viewshed(part, z, np.full(z.shape, np.nan), (x, y), observer_height_m=1.0)


def test_a_wall_hides_the_ground_behind_it_with_the_error_of_its_top() -> None:
    z = np.zeros(GRID.shape)
    z[:, 150] = 1.0  # at x = 5.05 m
    variance = np.full(GRID.shape, 1e-4)
    v = viewshed(GRID, z, variance, (0.05, 0.05), observer_height_m=2.0, target_height_m=0.5, range_m=9.5)
    row = 99
    x = GRID.x_centres_m()[190] - 0.05
    assert v.hidden_m[row, 190] == pytest.approx(2.0 - x / 5.0, abs=1e-9)
    assert v.hidden_m[row, 120] == 0.0
    t = 5.0 / x
    assert v.sigma_m[row, 190] == pytest.approx(0.01 * np.sqrt(1 + 1 / t**2 + (1 / t - 1) ** 2))
    assert v.visible[row, 190] > 0.999  # 0.2 m are hidden, the target is 0.5 m high
    edge = np.argmin(np.abs(v.hidden_m[row, 152:190] - 0.5)) + 152
    assert 0.0 < v.visible[row, edge] < 1.0
    assert np.isnan(v.visible[row, 197])


def test_unobserved_ground_does_not_block_the_view_and_is_stated() -> None:
    z = np.zeros(GRID.shape)
    z[:, 110:120] = np.nan
    v = viewshed(GRID, z, np.full(GRID.shape, np.nan), (0.05, 0.05), observer_height_m=1.0)
    assert v.visible[99, 150] == 1.0
    assert v.unobserved[99, 150] == pytest.approx(10 / 49)
    with pytest.raises(InputError, match="unobserved; choose"):
        viewshed(GRID, z, z, (1.55, 0.05), observer_height_m=1.0)


def test_contours_of_a_cone_are_circles_of_their_height() -> None:
    radius = np.hypot(X, Y)
    lines_by_height = {c.height_m: c.lines_m for c in contours(GRID, 10.0 - radius, 2.0)}
    assert set(lines_by_height) >= {2.0, 4.0, 6.0, 8.0}
    for height in (4.0, 6.0, 8.0):
        (line,) = lines_by_height[height]
        assert np.hypot(*line.T) == pytest.approx(10.0 - height, abs=0.01)
        assert np.array_equal(line[0], line[-1])
    with pytest.raises(InputError, match="larger interval"):
        list(contours(GRID, 1000.0 * radius, 0.01))
    assert list(contours(GRID, np.full(GRID.shape, np.nan), 1.0)) == []


def test_contour_cells_are_those_that_a_line_crosses() -> None:
    cells = contour_cells(0.5 * X, 1.0)
    columns = np.flatnonzero(np.isfinite(cells[50]))
    assert 0.5 * X[50, columns] == pytest.approx(cells[50, columns], abs=0.06)
    assert set(cells[50, columns]) == {-4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0}


def test_the_error_of_a_mean_contains_that_of_the_pose_once() -> None:
    heights = np.linspace(0.0, 2.0, 1000)
    result = height_statistics(heights, np.full(1000, 0.04), np.full(1000, 0.0025), 0.1, 1.0)
    assert result["mean_sigma_m"] == pytest.approx(np.sqrt(0.04 / 1000 + 0.0025))
    assert result["area_m2"] == pytest.approx(10.0)
    assert (
        result["volume_above_m3"] == pytest.approx(result["volume_below_m3"]) == pytest.approx(2.5, rel=0.01)
    )
    assert result["volume_sigma_m3"] == pytest.approx(10.0 * result["mean_sigma_m"])
    unknown = height_statistics(heights, np.full(1000, np.nan), heights, 0.1, None)
    assert (unknown["mean_sigma_m"], unknown["datum_m"]) == (None, 0.0)
    assert height_statistics(heights[:0], heights[:0], heights[:0], 0.1, None)["height_m"] is None
