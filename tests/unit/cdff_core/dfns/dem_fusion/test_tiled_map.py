# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_fusion.interface import DemFusionInputs
from cdff_core.dfns.dem_fusion.tiled_map import TILE, TiledMap


def patch(x0: float, frame: str = "site") -> ElevationMap:
    """Return a flat patch of 10 m x 10 m with one measurement in each cell of 0.1 m."""
    g = GridGeometry.aligned(frame, 0.1, (x0, -5.0, x0 + 10.0, 5.0))
    points = np.column_stack([*(c.ravel() for c in g.centres_m()), np.ones(g.rows * g.cols)])
    return ElevationMap.from_layers(
        g, CellStatistics.from_points(g, points, stamps_ns=0).to_layers(0), t0_ns=0, t1_ns=0
    )


def test_a_window_extends_across_the_borders_of_tiles() -> None:
    node = TiledMap()
    node.configure({"size_m": 4.0})
    edge = TILE * 0.1
    fused = node.process(DemFusionInputs(patch=patch(edge - 5.0), centre=np.array([edge, 0.0]))).map
    assert fused.geometry.shape == (40, 40)
    assert np.all(fused.layer("count") == 1)


def test_the_least_recently_used_tile_is_evicted_first() -> None:
    node = TiledMap()
    node.configure({"max_tiles": 4})
    for x0 in (0.0, 100.0, 200.0):
        node.process(DemFusionInputs(patch=patch(x0)))
    full_map = node.process(DemFusionInputs(bounds=np.array([0.0, -5.0, 20.0, 5.0]))).map
    assert np.nansum(full_map.layer("count")) == 0


def test_evicted_tiles_are_counted() -> None:
    node = TiledMap()
    node.configure({"max_tiles": 4})
    evicted_counts = [node.process(DemFusionInputs(patch=patch(x0))).forgotten for x0 in (0.0, 100.0, 200.0)]
    full_map = node.process(DemFusionInputs(bounds=np.full(4, np.nan)))
    assert evicted_counts == [0, 2, 4]  # the patches cover 2, 4 and 4 tiles
    assert full_map.forgotten == 0


def test_a_map_beyond_the_cell_limit_has_coarser_cells_with_every_measurement() -> None:
    node = TiledMap()
    node.configure({"max_cells": 1 << 14})
    for x0 in (0.0, 7000.0):  # with cells of 0.1 m, the box around both patches has 18 million cells
        node.process(DemFusionInputs(patch=patch(x0)))
    outputs = node.process(DemFusionInputs(bounds=np.full(4, np.nan))).map
    g = outputs.geometry
    factor = round(g.resolution_m / 0.1)
    assert factor & (factor - 1) == 0  # a power of two
    assert g.rows * g.cols <= 1 << 14
    assert np.nansum(outputs.layer("count")) == 20_000
    assert np.nanmax(np.abs(outputs.layer("mean") - 1.0)) == 0.0
    near = node.process(DemFusionInputs(bounds=np.array([0.0, -2.0, 4.0, 2.0]))).map
    assert (near.geometry.resolution_m, near.geometry.shape) == (0.1, (40, 40))


def test_the_limit_on_cells_is_never_exceeded(rng: np.random.Generator) -> None:
    node = TiledMap()
    node.configure({"max_cells": 1 << 14})
    node.process(DemFusionInputs(patch=patch(0.0)))
    for low, size in zip(rng.uniform(-3.0, 3.0, (400, 2)), rng.uniform(9.0, 17.0, (400, 2)), strict=True):
        g = node.process(DemFusionInputs(bounds=np.r_[low, low + size])).map.geometry
        assert g.rows * g.cols <= 1 << 14


def test_a_patch_without_rays_clears_no_cells() -> None:
    node = TiledMap()
    node.configure()
    outputs = node.process(DemFusionInputs(patch=patch(0.0), rays=np.zeros((0, 6))))
    assert outputs.cleared == 0
    assert np.nansum(outputs.map.layer("count")) == 10_000


def test_a_map_without_observed_cells_covers_the_unobserved_patch() -> None:
    node = TiledMap()
    node.configure()
    g = GridGeometry.aligned("site", 0.1, (0.0, -5.0, 10.0, 5.0))
    layers = CellStatistics.from_points(g, np.zeros((0, 3)), stamps_ns=0).to_layers(0)
    unobserved = ElevationMap.from_layers(g, layers, t0_ns=0, t1_ns=0)
    whole_map = node.process(DemFusionInputs(patch=unobserved, bounds=np.full(4, np.nan))).map
    assert whole_map.geometry == g
    assert np.nansum(whole_map.layer("count")) == 0


def test_a_map_is_available_after_the_first_patch_and_a_patch_in_another_frame_starts_a_new_one() -> None:
    node = TiledMap()
    node.configure()
    with pytest.raises(InputError, match="no patch yet"):
        node.process(DemFusionInputs())
    node.process(DemFusionInputs(patch=patch(0.0)))
    node.process(DemFusionInputs(patch=patch(50.0, "mana/odom")))
    full_map = node.process(DemFusionInputs(bounds=np.full(4, np.nan))).map
    assert full_map.frame == "mana/odom"
    assert np.nansum(full_map.layer("count")) == 10_000


def test_the_cells_of_a_map_are_the_smallest_doubled_ones_within_the_limit() -> None:
    node = TiledMap()
    node.configure({"max_cells": 1 << 14})
    node.process(DemFusionInputs(patch=patch(0.0)))
    grid = node.process(DemFusionInputs(bounds=np.array([0.0, 0.0, 100.0, 100.0]))).map.geometry
    assert grid.resolution_m == pytest.approx(0.8)
