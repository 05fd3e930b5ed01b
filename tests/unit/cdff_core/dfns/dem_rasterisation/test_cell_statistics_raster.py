# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_rasterisation.cell_statistics_raster import CellStatisticsRaster
from cdff_core.dfns.dem_rasterisation.interface import DemRasterisationInputs

T_NS = 1_700_000_000_000_000_000


def rasterise(points: np.ndarray, *, config: dict[str, Any] | None = None, **inputs: Any) -> ElevationMap:
    node = CellStatisticsRaster()
    node.configure({"resolution_m": 0.5, **(config or {})})
    return node.process(DemRasterisationInputs(frame="site", points=points, **inputs)).map


def test_the_grid_is_the_smallest_aligned_one_that_contains_all_points(rng: np.random.Generator) -> None:
    points = rng.uniform(-3.3, 7.7, (500, 3))
    dem = rasterise(points)
    b = dem.geometry.bounds
    assert dem.frame == "site"
    assert (b.xmin, b.ymax) == (
        np.floor(points[:, 0].min() / 0.5) * 0.5,
        np.floor(points[:, 1].max() / 0.5) * 0.5 + 0.5,
    )
    assert np.nansum(dem.layer("count")) == 500


def test_a_point_on_the_upper_edge_lies_in_the_cell_above() -> None:
    dem = rasterise(np.array([[0.0, 0.0, 1.0], [0.5, 0.5, 2.0]]))
    assert dem.geometry.shape == (2, 2)
    np.testing.assert_array_equal(dem.layer("mean"), [[np.nan, 2.0], [1.0, np.nan]])


def test_a_map_has_the_documented_layers_and_nan_in_unobserved_cells() -> None:
    dem = rasterise(
        np.array([[0.1, 0.1, 1.0], [1.1, 0.1, 3.0], [1.2, 0.2, 5.0]]),
        stamps_ns=np.array([T_NS, T_NS, T_NS + 2000]),
    )
    assert dem.layer_names == ("mean", "variance", "min", "max", "count", "age_s")
    np.testing.assert_array_equal(dem.layer("mean"), [[1, np.nan, 4]])
    np.testing.assert_array_equal(dem.layer("variance"), [[0, np.nan, 1]])
    np.testing.assert_array_equal(dem.layer("min"), [[1, np.nan, 3]])
    np.testing.assert_array_equal(dem.layer("max"), [[1, np.nan, 5]])
    np.testing.assert_array_equal(dem.layer("count"), [[1, np.nan, 2]])
    np.testing.assert_allclose(dem.layer("age_s"), [[2e-6, np.nan, 0]], rtol=1e-6)
    assert (dem.t0_ns, dem.t1_ns) == (T_NS, T_NS + 2000)


def test_point_variances_are_added_to_the_scatter() -> None:
    dem = rasterise(np.array([[0.1, 0.1, 1.0], [0.2, 0.2, 3.0]]), height_variance=np.array([0.25, 0.75]))
    assert dem.layer("variance")[0, 0] == pytest.approx(1.5)


def test_outliers_that_would_enlarge_the_grid_are_refused_and_infinite_ones_omitted() -> None:
    with pytest.raises(InputError, match="cells"):
        rasterise(np.array([[0.0, 0, 0], [1e6, 1e6, 0]]))
    assert rasterise(np.array([[0.0, 0, 0], [np.inf, 0, 0], [0, np.nan, 0]])).geometry.shape == (1, 1)
    with pytest.raises(InputError, match="finite"):
        rasterise(np.full((3, 3), np.nan))
