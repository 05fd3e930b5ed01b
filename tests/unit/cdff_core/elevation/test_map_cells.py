# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_fusion.interface import DemFusionInputs
from cdff_core.dfns.dem_fusion.rolling_window import RollingWindow
from cdff_core.dfns.dem_fusion.tiled_map import TiledMap
from cdff_core.dfns.dem_rasterisation.cell_statistics_raster import CellStatisticsRaster
from cdff_core.dfns.dem_rasterisation.interface import DemRasterisationInputs
from cdff_core.elevation.map_cells import MapCells, window_around
from cdff_core.elevation.visibility import clear_seen_through

S = 1_000_000_000


def raster(points: np.ndarray, t_ns: int = 0, **config: float) -> ElevationMap:
    node = CellStatisticsRaster()
    node.configure({"resolution_m": 0.5, **config})
    n = len(points)
    return node.process(
        DemRasterisationInputs(
            frame="site",
            points=points,
            height_variance=np.full(n, 0.01),
            noise_variance=np.full(n, 0.04),
            intensity=np.arange(n, dtype=float),
            stamps_ns=np.full(n, t_ns),
        )
    ).map


def ground(rng: np.random.Generator, x0: float, n: int = 4000) -> np.ndarray:
    xy = rng.uniform(0, 10, (n, 2)) + np.array([x0, 0.0])
    return np.column_stack([xy, 0.1 * xy[:, 0]])


def test_the_pose_error_is_not_reduced_by_the_number_of_heights() -> None:
    result = raster(np.tile([[0.2, 0.2, 1.0]], (100, 1)))
    assert abs(result.layer("error_variance")[0, 0] - (0.01 + 0.04 / 100)) < 1e-6
    assert abs(result.layer("variance")[0, 0] - 0.05) < 1e-6
    assert result.layer("intensity")[0, 0] == 49.5


def test_a_single_height_has_the_uncertainty_of_the_local_relief() -> None:
    x, y = np.meshgrid(np.arange(0.25, 5, 0.5), np.arange(0.25, 5, 0.5))
    slope = raster(np.column_stack([x.ravel(), y.ravel(), 0.4 * x.ravel()]))
    flat = raster(np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]))
    extra = slope.layer("error_variance")[5, 5] - flat.layer("error_variance")[5, 5]
    assert abs(extra - (0.4 * 0.5) ** 2 / 12) < 1e-4


def test_an_overhang_is_stored_in_its_own_layer() -> None:
    points = np.array([[0.1, 0.1, 0.0], [0.2, 0.2, 0.3], [0.1, 0.2, 2.0], [0.3, 0.1, 2.5], [0.7, 0.1, 2.0]])
    result = raster(points, overhang_gap_m=1.0)
    np.testing.assert_allclose(result.layer("max"), [[0.3, 2.0]], atol=1e-6)
    np.testing.assert_array_equal(result.layer("count"), [[2, 1]])
    np.testing.assert_array_equal(result.layer("overhang_m"), [[2.0, np.nan]])


def test_an_isolated_point_above_the_ground_is_removed_as_noise() -> None:
    result = raster(np.array([[0.1, 0.1, 0.0], [0.2, 0.2, 0.1], [0.2, 0.1, 1.4]]), overhang_gap_m=1.0)
    np.testing.assert_allclose(result.layer("max"), [[0.1]], atol=1e-6)
    assert "overhang_m" not in result.layer_names


def test_tiles_store_cells_outside_a_moving_window_and_contain_the_same_cells_inside(
    rng: np.random.Generator,
) -> None:
    window, tiles = RollingWindow(), TiledMap()
    for node in (window, tiles):
        node.configure({"size_m": 20.0})
    for k, x0 in enumerate((0.0, 4.0, 2.0)):
        inputs = DemFusionInputs(patch=raster(ground(rng, x0), k * S), centre=np.array([x0 + 5.0, 5.0]))
        in_window, in_tiles = window.process(inputs).map, tiles.process(inputs).map
    assert in_window.geometry == in_tiles.geometry
    observed = np.isfinite(in_window.layer("mean"))
    for name in ("mean", "variance", "count", "pose_variance", "intensity"):
        np.testing.assert_allclose(
            in_tiles.layer(name)[observed], in_window.layer(name)[observed], rtol=1e-5, err_msg=name
        )
    distant = DemFusionInputs(patch=raster(ground(rng, 60.0), 9 * S))
    in_window = window.process(distant).map
    tiles.process(distant)
    whole_map = tiles.process(DemFusionInputs(bounds=np.full(4, np.nan))).map
    assert np.nansum(whole_map.layer("count")) == 16000
    assert np.nansum(in_window.layer("count")) < 16000


def test_memory_grows_with_the_observed_area_not_with_the_path_length(rng: np.random.Generator) -> None:
    near, far = TiledMap(), TiledMap()
    for node, x0 in ((near, 64.0), (far, 6400.0)):
        node.configure({})
        for start in (0.0, x0):
            node.process(DemFusionInputs(patch=raster(ground(rng, start))))
    assert far.nbytes == near.nbytes


def test_points_crossed_by_later_rays_are_removed() -> None:
    g = GridGeometry.aligned("site", 0.5, (0.0, 0.0, 10.0, 1.0))
    z = np.zeros(g.shape, np.float32)
    z[:, 10] = 1.5
    layers = {"mean": z, "variance": z * 0, "min": z, "max": z, "count": z * 0 + 3, "age_s": z * 0}
    cells = MapCells.of_map(ElevationMap.from_layers(g, layers, t0_ns=0, t1_ns=S))
    rays = np.array([[0.0, 0.75, 1.0, 9.9, 0.75, 0.0], [0.0, 0.75, 1.0, 9.8, 0.75, 0.0]])
    assert clear_seen_through(cells, rays[:1], 2 * S, 0.1) == 0  # one ray may be wrong
    assert clear_seen_through(cells, rays, S, 0.1) == 0  # the cell was measured at the time of the rays
    assert clear_seen_through(cells, rays, 2 * S, 0.1) == 1
    assert not cells.statistics.observed[0, 10]
    assert np.count_nonzero(~cells.statistics.observed) == 1


@pytest.mark.parametrize("size_m", [0.5, 2.0, 2.5])
def test_a_window_has_the_position_in_its_middle_cell_or_the_upper_right_one_of_four(size_m: float) -> None:
    for x_m, y_m in np.random.default_rng(2).uniform(-20.0, 20.0, (50, 2)):
        grid = window_around("site", 0.5, np.array([x_m, y_m]), size_m)
        assert grid.rows == grid.cols == round(size_m / 0.5)
        column, row = int((x_m - grid.xmin_m) / 0.5), int((grid.ymax_m - y_m) / 0.5)
        assert (column, row) == (grid.cols // 2, (grid.rows - 1) // 2)
        assert grid.xmin_m % 0.5 == grid.ymax_m % 0.5 == 0.0
