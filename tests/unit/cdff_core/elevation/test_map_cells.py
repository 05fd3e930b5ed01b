# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_fusion._interface import DemFusionInputs
from cdff_core.dfns.dem_fusion.rolling_window import RollingWindow
from cdff_core.dfns.dem_fusion.tiled_map import TiledMap
from cdff_core.dfns.dem_rasterisation._interface import DemRasterisationInputs
from cdff_core.dfns.dem_rasterisation.cell_statistics_raster import CellStatisticsRaster
from cdff_core.elevation.map_cells import MapCells
from cdff_core.elevation.visibility import clear_seen_through

S = 1_000_000_000


def raster(points: np.ndarray, t_ns: int = 0, **config: float) -> ElevationMap:
    node = CellStatisticsRaster()
    node.configure({"resolution_m": 0.5, "frame": "site", **config})
    n = len(points)
    return node.process(
        DemRasterisationInputs(
            points=points, height_variance=np.full(n, 0.01), noise_variance=np.full(n, 0.04),
            intensity=np.arange(n, dtype=float), stamps_ns=np.full(n, t_ns),
        )
    ).map  # fmt: skip


def ground(rng: np.random.Generator, x0: float, n: int = 4000) -> np.ndarray:
    xy = rng.uniform(0, 10, (n, 2)) + np.array([x0, 0.0])
    return np.column_stack([xy, 0.1 * xy[:, 0]])


def test_the_poses_part_of_the_error_does_not_shrink_with_the_number_of_heights() -> None:
    many = raster(np.tile([[0.2, 0.2, 1.0]], (100, 1)))
    assert abs(many.layer("error_variance")[0, 0] - (0.01 + 0.04 / 100)) < 1e-6
    assert abs(many.layer("variance")[0, 0] - 0.05) < 1e-6
    assert many.layer("intensity")[0, 0] == 49.5


def test_one_height_in_a_cell_is_uncertain_by_the_relief_that_its_neighbours_show() -> None:
    x, y = np.meshgrid(np.arange(0.25, 5, 0.5), np.arange(0.25, 5, 0.5))
    slope = raster(np.column_stack([x.ravel(), y.ravel(), 0.4 * x.ravel()]))
    flat = raster(np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]))
    extra = slope.layer("error_variance")[5, 5] - flat.layer("error_variance")[5, 5]
    assert abs(extra - (0.4 * 0.5) ** 2 / 12) < 1e-4


def test_what_hangs_over_a_cell_is_not_ground() -> None:
    points = np.array([[0.1, 0.1, 0.0], [0.2, 0.2, 0.3], [0.1, 0.2, 2.0], [0.3, 0.1, 2.5], [0.7, 0.1, 2.0]])
    made = raster(points, overhang_gap_m=1.0)
    np.testing.assert_allclose(made.layer("max"), [[0.3, 2.0]], atol=1e-6)
    np.testing.assert_array_equal(made.layer("count"), [[2, 1]])
    np.testing.assert_array_equal(made.layer("overhang_m"), [[2.0, np.nan]])


def test_one_point_alone_above_the_ground_is_noise_neither_ground_nor_overhang() -> None:
    made = raster(np.array([[0.1, 0.1, 0.0], [0.2, 0.2, 0.1], [0.2, 0.1, 1.4]]), overhang_gap_m=1.0)
    np.testing.assert_allclose(made.layer("max"), [[0.1]], atol=1e-6)
    assert "overhang_m" not in made.layer_names


def test_tiles_hold_what_a_moving_window_forgets_and_give_the_same_window(rng: np.random.Generator) -> None:
    window, tiles = RollingWindow(), TiledMap()
    for node in (window, tiles):
        node.configure({"size_m": 20.0})
    for k, x0 in enumerate((0.0, 4.0, 2.0)):
        inputs = DemFusionInputs(patch=raster(ground(rng, x0), k * S), centre=np.array([x0 + 5.0, 5.0]))
        first, second = window.process(inputs).map, tiles.process(inputs).map
    assert first.geometry == second.geometry
    there = np.isfinite(first.layer("mean"))
    for name in ("mean", "variance", "count", "pose_variance", "intensity"):
        np.testing.assert_allclose(second.layer(name)[there], first.layer(name)[there], rtol=1e-5,
                                   err_msg=name)  # fmt: skip
    away = DemFusionInputs(patch=raster(ground(rng, 60.0), 9 * S))
    first = window.process(away).map
    tiles.process(away)
    whole = tiles.process(DemFusionInputs(bounds=np.full(4, np.nan))).map
    assert np.nansum(whole.layer("count")) == 16000
    assert np.nansum(first.layer("count")) < 16000


def test_memory_grows_with_the_area_seen_not_with_the_way_between(rng: np.random.Generator) -> None:
    near, far = TiledMap(), TiledMap()
    for node, x0 in ((near, 64.0), (far, 6400.0)):
        node.configure({})
        for start in (0.0, x0):
            node.process(DemFusionInputs(patch=raster(ground(rng, start))))
    assert far.nbytes == near.nbytes


def test_what_later_rays_pass_below_is_forgotten_and_the_rest_stays() -> None:
    g = GridGeometry.aligned("site", 0.5, (0.0, 0.0, 10.0, 1.0))
    z = np.zeros(g.shape, np.float32)
    z[:, 10] = 1.5
    layers = {"mean": z, "variance": z * 0, "min": z, "max": z, "count": z * 0 + 3, "age_s": z * 0}
    cells = MapCells.of_map(ElevationMap.from_layers(g, layers, t0_ns=0, t1_ns=S))
    rays = np.array([[0.0, 0.75, 1.0, 9.9, 0.75, 0.0], [0.0, 0.75, 1.0, 9.8, 0.75, 0.0]])
    assert clear_seen_through(cells, rays[:1], 2 * S, 0.1) == 0  # one ray may be wrong
    assert clear_seen_through(cells, rays, S, 0.1) == 0  # measured at that time
    assert clear_seen_through(cells, rays, 2 * S, 0.1) == 1
    assert not cells.statistics.observed[0, 10]
    assert np.count_nonzero(~cells.statistics.observed) == 1
