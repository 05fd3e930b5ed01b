# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Map tiles: images without seams, values, ETags, and the documents that describe the tile grid."""

from __future__ import annotations

import io
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from cdff_common.raster import GridGeometry, hillshade
from cdff_common.raster.tiles import Tile, tiles_over
from cdff_common.types import ElevationMap
from services.dpm.operations.dpm import Dpm
from services.dpm.rendering.tiles import LAYERS, TileRequest, render_elevation

from .conftest import S, TestClient, elevation, put_arguments


def hills(left: int, cols: int, top: int = 200, rows: int = 200, seq: int = 1) -> ElevationMap:
    """Return hilly ground in cells of 10 cm; ``left`` and ``top`` are indices in the grid of the frame."""
    geometry = GridGeometry.from_cells("site", 0.1, left=left, top=top, rows=rows, cols=cols)
    x, y = geometry.centres_m()
    mean = (np.sin(x / 2.0) + np.cos(y / 3.0)).astype(np.float32)
    ones = np.ones_like(mean)
    layers = {
        "mean": mean,
        "variance": ones * 1e-3,
        "min": mean,
        "max": mean,
        "count": ones,
        "age_s": ones * 0,
    }
    return ElevationMap.from_layers(geometry, layers, t0_ns=seq * S, t1_ns=seq * S)


def put_hills(dpm: Dpm) -> None:
    """Insert two patches that touch at x = 0."""
    for seq, left in enumerate((-200, 0), 1):
        dpm.writer.put(*put_arguments(hills(left, 200, seq=seq), "dem", seq, resolution_m=0.1))


def pixels(data: bytes) -> np.ndarray:
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"))


@pytest.mark.parametrize("layer", [name for name, product in LAYERS.items() if product == "dem"])
def test_a_tile_is_an_image_transparent_in_unknown_cells(dpm: Dpm, layer: str) -> None:
    put_hills(dpm)
    columns, rows = tiles_over(17, (-19.0, 1.0, 19.0, 1.0))
    assert len(columns) == 2
    for x in columns:
        rgba = pixels(dpm.tiles.get(TileRequest("site", layer, Tile(17, x, rows[0]))).data)
        assert rgba.shape == (256, 256, 4)
        is_opaque = rgba[..., 3] > 0
        assert 0.55 < is_opaque.mean() < 0.65
        assert len(np.unique(rgba[is_opaque], axis=0)) > (0 if layer == "variance" else 20)


def test_shading_has_no_seam_between_tiles(dpm: Dpm) -> None:
    put_hills(dpm)
    columns, rows = tiles_over(17, (-19.0, 1.0, 19.0, 1.0))
    tiles = [
        dpm.tiles.get(TileRequest("site", "hillshade", Tile(17, x, rows[0]), "bin")).data for x in columns
    ]
    side_by_side = np.hstack([np.frombuffer(data, "<f4").reshape(256, 256) for data in tiles])
    left_tile = Tile(17, columns[0], rows[0]).geometry("site")
    # Both tiles with a margin of one cell.
    both = GridGeometry.from_cells(
        "site", 0.1, left=left_tile.left - 1, top=left_tile.top + 1, rows=258, cols=514
    )
    window = hills(-200, 400)
    heights = np.full(both.shape, np.nan)
    common = both.intersection(window.geometry)
    assert common is not None
    heights[both.slices_of(common)] = window.layer("mean")[window.geometry.slices_of(common)]
    expected = hillshade(heights, 0.1)[1:-1, 1:-1].astype(np.float32)
    expected[expected == 0] = np.nan
    np.testing.assert_allclose(side_by_side, expected, atol=1.0)


def test_values_are_returned_as_geotiff_and_as_plain_numbers(dpm: Dpm) -> None:
    put_hills(dpm)
    columns, rows = tiles_over(17, (1.0, 1.0, 1.0, 1.0))
    tile = Tile(17, columns[0], rows[0])
    values = np.frombuffer(dpm.tiles.get(TileRequest("site", "elevation", tile, "bin")).data, "<f4").reshape(
        256, 256
    )
    from rasterio.io import MemoryFile

    data = dpm.tiles.get(TileRequest("site", "elevation", tile, "tif")).data
    with MemoryFile(data) as memory, memory.open() as file:
        np.testing.assert_array_equal(file.read(1), values)
        assert tuple(file.bounds) == pytest.approx(tuple(tile.geometry("site").bounds))
        assert "site" in file.crs.to_wkt()
    slope = np.frombuffer(dpm.tiles.get(TileRequest("site", "slope", tile, "bin")).data, "<f4")
    assert 5.0 < np.nanmax(slope) < 45.0


def test_a_tile_is_rendered_again_only_after_an_insertion_within_it(dpm: Dpm) -> None:
    put_hills(dpm)
    columns, rows = tiles_over(17, (1.0, 1.0, 1.0, 1.0))
    request = TileRequest("site", "elevation", Tile(17, columns[0], rows[0]))
    first = dpm.tiles.get(request)
    assert dpm.tiles.get(request) is first
    dpm.writer.put(*put_arguments(elevation(300.0), "dem", 8, resolution_m=0.1))
    assert dpm.tiles.get(request) is first
    dpm.writer.put(*put_arguments(elevation(3.0, 5.0), "dem", 9, resolution_m=0.1))
    changed = dpm.tiles.get(request)
    assert changed.etag != first.etag


def test_a_tile_is_not_kept_if_a_map_is_inserted_while_it_is_rendered(
    dpm: Dpm, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_hills(dpm)
    columns, rows = tiles_over(17, (1.0, 1.0, 1.0, 1.0))
    request = TileRequest("site", "elevation", Tile(17, columns[0], rows[0]))

    def insert_and_render(*arguments: Any) -> bytes:
        monkeypatch.undo()
        dpm.writer.put(*put_arguments(elevation(3.0, 5.0), "dem", 9, resolution_m=0.1))
        dpm.store.pyramid.sync()
        return render_elevation(*arguments)

    monkeypatch.setattr("services.dpm.rendering.tiles.render_elevation", insert_and_render)
    outdated = dpm.tiles.get(request)
    changed = dpm.tiles.get(request)
    assert changed.etag != outdated.etag
    assert dpm.tiles.get(request) is changed


def test_an_unchanged_tile_is_answered_with_304(http: TestClient, dpm: Dpm) -> None:
    put_hills(dpm)
    columns, rows = tiles_over(17, (1.0, 1.0, 1.0, 1.0))
    path = f"/tiles/hillshade/17/{columns[0]}/{rows[0]}.png"
    answer = http.get(path)
    assert (answer.status_code, answer.headers["content-type"]) == (200, "image/png")
    unchanged = http.get(path, headers={"If-None-Match": answer.headers["etag"]})
    assert (unchanged.status_code, unchanged.content) == (304, b"")
    assert http.get(f"{path}?low=5&high=1").status_code == 422
    assert http.get("/tiles/soil/0/0/0.png").status_code == 422
    assert http.get("/tiles/dem/2/4/0.png").status_code == 422
    assert http.get("/tiles/dem/2/1/0.jpg").status_code == 422


def test_tile_matrix_set_layer_list_and_wmts_document_agree(http: TestClient) -> None:
    matrix_set = http.get("/tiles/tile_matrix_set").json()
    layers = http.get("/tiles").json()["items"]
    assert [layer["name"] for layer in layers] == list(LAYERS)
    assert matrix_set["crs"]["wkt"]["type"] == "EngineeringCRS"
    root = ET.fromstring(http.get("/tiles/wmts.xml").content)
    space = {"w": "http://www.opengis.net/wmts/1.0", "o": "http://www.opengis.net/ows/1.1"}
    matrices = root.findall(".//w:TileMatrix", space)
    assert len([m for m in matrices if m.find("w:TopLeftCorner", space) is not None]) == len(
        matrix_set["tileMatrices"]
    )
    assert [e.text for e in root.findall(".//w:Layer/o:Identifier", space)] == list(LAYERS)
    assert "/tiles/dem/{TileMatrix}/{TileCol}/{TileRow}.png" in root.findall(".//w:ResourceURL", space)[
        0
    ].get("template", "")
