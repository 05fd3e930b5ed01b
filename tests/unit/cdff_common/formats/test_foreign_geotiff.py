# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation models of other programs: any edges, directions, nodata and integer types, in metres."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.io import MemoryFile

from cdff_common.errors import CodecError
from cdff_common.formats.geotiff import read_bands, read_map
from cdff_common.raster import GridGeometry

UTM, GEOGRAPHIC, FEET = "EPSG:32633", "EPSG:4326", "EPSG:2229"


def slope(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(0.3 * x - 0.2 * y)


def geotiff(
    band: np.ndarray, transform: Any, crs: str = UTM, scale: float = 1.0, offset: float = 0.0, **options: Any
) -> bytes:
    profile = {"driver": "GTiff", "count": 1, "height": band.shape[0], "width": band.shape[1], **options}
    with MemoryFile() as memory:
        with memory.open(dtype=band.dtype, transform=transform, crs=crs, **profile) as file:
            file.write(band, 1)
            file.scales, file.offsets = (scale,), (offset,)
        return bytes(memory.read())


def centres(transform: rasterio.Affine, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    row, col = np.indices(shape) + 0.5
    return transform.c + transform.a * col, transform.f + transform.e * row


@pytest.mark.parametrize(
    "transform",
    [
        pytest.param(rasterio.Affine(2.0, 0, 500_000.7, 0, -2.0, 5_400_001.3), id="edges off the grid"),
        pytest.param(rasterio.Affine(2.0, 0, 500_000.0, 0, 2.0, 5_400_000.0), id="rows from the south"),
        pytest.param(rasterio.Affine(-2.0, 0, 500_000.0, 0, -2.0, 5_400_000.0), id="columns from the east"),
        pytest.param(rasterio.Affine(1.2, 0, 500_000.0, 0, -2.0, 5_400_000.0), id="cells not square"),
        pytest.param(rasterio.Affine(0.3, 0, 499_999.95, 0, -0.3, 5_399_999.85), id="half a cell off"),
    ],
)
def test_heights_are_at_their_place_for_any_edges_and_directions(transform: rasterio.Affine) -> None:
    x, y = centres(transform, (40, 30))
    heights = slope(x - 500_000.0, y - 5_400_000.0).astype(np.float32)
    dem = read_map(geotiff(heights, transform))
    grid = dem.geometry
    assert grid.resolution_m == max(abs(transform.a), abs(transform.e))
    x, y = grid.centres_m()
    mean = dem.layer("mean")
    observed = np.isfinite(mean)
    assert observed.mean() > 0.85
    expected = slope(x - 500_000.0, y - 5_400_000.0)
    np.testing.assert_allclose(mean[observed], expected[observed], atol=0.05 * 0.3 * grid.resolution_m)
    if "variance" in dem.layer_names:
        within_cell = np.sqrt(dem.layer("variance")[observed])
        assert within_cell.max() < 0.5 * np.hypot(0.3, 0.2) * grid.resolution_m * np.sqrt(2.0)


def test_heights_on_the_grid_are_not_changed() -> None:
    heights = np.arange(12, dtype=np.float32).reshape(3, 4)
    dem = read_map(geotiff(heights, rasterio.Affine(2.0, 0, 500_000, 0, -2.0, 5_400_000)), frame="mars")
    assert dem.geometry == GridGeometry("mars", 2.0, 500_000.0, 5_400_000.0, 3, 4)
    np.testing.assert_array_equal(dem.layer("mean"), heights)
    assert "variance" not in dem.layer_names


@pytest.mark.parametrize("xmin_m", [500_000.0, 500_000.5])
def test_integers_with_nodata_scale_and_offset_are_heights(xmin_m: float) -> None:
    stored = np.full((6, 8), 100, np.int16)
    stored[2, 3] = -32768
    transform = rasterio.Affine(2.0, 0, xmin_m, 0, -2.0, 5_400_000)
    mean = read_map(geotiff(stored, transform, scale=0.1, offset=5.0, nodata=-32768)).layer("mean")
    observed = np.isfinite(mean)
    assert not observed.all()
    np.testing.assert_allclose(mean[observed], 15.0, atol=1e-5)


@pytest.mark.parametrize(
    ("transform", "crs", "message"),
    [
        (rasterio.Affine(0.01, 0, 15.0, 0, -0.01, 48.0), GEOGRAPHIC, "degrees.*gdalwarp"),
        (rasterio.Affine(2.0, 0, 6e6, 0, -2.0, 1e6), FEET, "foot.*expected metres"),
        (rasterio.Affine(2.0, 0.1, 0.0, 0.1, -2.0, 0.0), UTM, "rows parallel"),
    ],
)
def test_other_units_and_rotated_rasters_are_refused_with_the_remedy(
    transform: rasterio.Affine, crs: str, message: str
) -> None:
    with pytest.raises(CodecError, match=message):
        read_map(geotiff(np.zeros((4, 4), np.float32), transform, crs))


def test_a_navigation_map_is_not_averaged_onto_a_grid() -> None:
    data = geotiff(np.ones((4, 4), np.float32), rasterio.Affine(2.0, 0, 0.5, 0, -2.0, 0.0))
    with pytest.raises(CodecError, match="multiple of the cell size"):
        read_map(data, "NavigationMap")
    with pytest.raises(CodecError, match="square cells"):
        read_bands(geotiff(np.ones((4, 4), np.float32), rasterio.Affine(2.0, 0, 0.0, 0, -1.0, 0.0)))
