# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_fusion.interface import DemFusionInputs
from cdff_core.dfns.dem_fusion.rolling_window import RollingWindow

T_NS = 1_700_000_000_000_000_000


def fusion(**config: Any) -> RollingWindow:
    node = RollingWindow()
    node.configure(config)
    return node


def patch(
    points: np.ndarray, t_ns: int = T_NS, frame: str = "site", resolution_m: float = 0.25
) -> ElevationMap:
    low, high = points.min(axis=0), points.max(axis=0) + 1e-6
    g = GridGeometry.aligned(frame, resolution_m, (low[0], low[1], high[0], high[1]))
    layers = CellStatistics.from_points(g, points, stamps_ns=t_ns).to_layers(t_ns)
    return ElevationMap.from_layers(g, layers, t0_ns=t_ns, t1_ns=t_ns)


def test_patches_fuse_to_the_statistics_of_all_points(rng: np.random.Generator) -> None:
    points = np.column_stack([rng.uniform(-4, 4, (6000, 2)), rng.normal(2.0, 0.3, 6000)])
    node = fusion(size_m=10.0)
    for i, part in enumerate(np.array_split(points, 6)):
        fused = node.process(DemFusionInputs(patch=patch(part, T_NS + i * 1000), centre=np.zeros(2))).map
    direct = CellStatistics.from_points(fused.geometry, points, stamps_ns=T_NS).to_layers(T_NS)
    np.testing.assert_array_equal(fused.layer("count"), direct["count"])
    for name in ("mean", "min", "max"):
        np.testing.assert_allclose(fused.layer(name), direct[name], atol=2e-6)
    np.testing.assert_allclose(fused.layer("variance"), direct["variance"], atol=2e-6)
    assert (fused.t0_ns, fused.t1_ns) == (T_NS, T_NS + 5000)


def test_two_contradicting_flat_patches_make_an_uncertain_cell_in_either_order() -> None:
    flat = np.column_stack([np.tile([[0.1, 0.1]], (50, 1)), np.zeros(50)])
    for first, second in ((0.0, 0.3), (0.3, 0.0)):
        node = fusion(size_m=1.0)
        node.process(DemFusionInputs(patch=patch(flat + np.array([0, 0, first]))))
        fused = node.process(DemFusionInputs(patch=patch(flat + np.array([0, 0, second])))).map
        assert np.sqrt(np.nanmax(fused.layer("variance"))) == pytest.approx(0.15, rel=1e-5)


def test_the_window_follows_its_centre_and_discards_cells_outside(rng: np.random.Generator) -> None:
    node = fusion(size_m=4.0)
    square = np.column_stack([rng.uniform(-1, 1, (2000, 2)), np.zeros(2000)])
    for x in np.arange(0.0, 30.0, 1.0):
        fused = node.process(
            DemFusionInputs(patch=patch(square + np.array([x, 0, 0])), centre=np.array([x, 0.0]))
        ).map
    assert fused.geometry.shape == (16, 16)
    b = fused.geometry.bounds
    assert b.xmin <= 29.0 - 1.75
    assert b.xmax >= 29.0 + 1.75
    assert np.isfinite(fused.layer("mean")).mean() > 0.3


def test_patches_are_aggregated_to_coarser_cells_on_request(rng: np.random.Generator) -> None:
    points = np.column_stack([rng.uniform(-1, 1, (500, 2)), rng.normal(0, 1, 500)])
    fused = (
        fusion(size_m=4.0, resolution_m=0.5)
        .process(DemFusionInputs(patch=patch(points), centre=np.zeros(2)))
        .map
    )
    assert fused.geometry.resolution_m == 0.5
    assert np.nansum(fused.layer("count")) == 500
    with pytest.raises(InputError, match="do not fit"):
        fusion(size_m=4.0, resolution_m=0.3).process(DemFusionInputs(patch=patch(points)))


def test_a_patch_in_another_frame_starts_a_new_map() -> None:
    node = fusion(size_m=2.0)
    node.process(DemFusionInputs(patch=patch(np.array([[0.1, 0.1, 1.0]])), centre=np.zeros(2)))
    fused = node.process(
        DemFusionInputs(
            patch=patch(np.array([[0.6, 0.6, 5.0]]), T_NS + 9000, frame="site_2"), centre=np.zeros(2)
        )
    ).map
    assert (fused.frame, np.nansum(fused.layer("count")), fused.t0_ns) == ("site_2", 1.0, T_NS + 9000)
