# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Map tiles: images without seams, values, ETags, and the documents that describe the tile grid."""

from __future__ import annotations

import io
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from rasterio.io import MemoryFile

from cdff_common.clock import ManualClock
from cdff_common.geodesy import Anchor, FrameLocation, body
from cdff_common.geodesy.body_grid import BodyTile, body_grid
from cdff_common.interfaces.product import Quality, Status
from cdff_common.raster import GridGeometry, hillshade
from cdff_common.raster.tiles import Tile, tiles_over
from cdff_common.types import ElevationMap
from services.dpm.operations.dpm import Dpm
from services.dpm.rendering.tiles import LAYERS, TileRequest, encoded_layer

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
        assert len(np.unique(rgba[is_opaque], axis=0)) > (0 if layer in ("variance", "roughness") else 20)


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
    expected[expected == 0] = np.nan  # unobserved cells are 0 in the image, NaN in the values
    np.testing.assert_allclose(side_by_side, expected, atol=1.0)


def test_values_are_returned_as_geotiff_and_as_plain_numbers(dpm: Dpm) -> None:
    put_hills(dpm)
    columns, rows = tiles_over(17, (1.0, 1.0, 1.0, 1.0))
    tile = Tile(17, columns[0], rows[0])
    values = np.frombuffer(dpm.tiles.get(TileRequest("site", "elevation", tile, "bin")).data, "<f4").reshape(
        256, 256
    )
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
        return encoded_layer(*arguments)

    monkeypatch.setattr("services.dpm.rendering.tiles.encoded_layer", insert_and_render)
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


def values_of(http: TestClient, path: str, **parameters: Any) -> np.ndarray:
    answer = http.get(path, params=parameters)
    assert answer.status_code == 200, answer.text
    return np.frombuffer(answer.content, "<f4").reshape(256, 256)


def test_a_tile_of_the_grid_of_the_body_shows_the_cells_at_its_place(http: TestClient, dpm: Dpm) -> None:
    anchor = Anchor(body("mars"), 77.45, 18.44, azimuth_deg=30.0, height_m=-2500.0)
    dpm.store.anchors.anchor("site", anchor)
    put_hills(dpm)
    grid = body_grid(body("mars"))
    assert grid is not None
    assert http.get("/tiles").json()["body_grid"] == grid.name == "IAU_2015_49910"
    z = 18
    ((x_m, y_m),) = grid.from_lonlat(anchor.lonlat([[2.0, 3.0]])[:, :2])
    side = 256 * grid.cell_m(z)
    column, row = int((x_m + grid.half_side_m) // side), int((grid.half_side_m - y_m) // side)
    path = f"/tiles/elevation/{z}/{column}/{row}"
    values = values_of(http, f"{path}.bin", grid=grid.name)
    assert 0.02 < np.isfinite(values).mean() < 1.0
    geometry = BodyTile(grid, z, column, row).geometry
    x, y = geometry.centres_m()
    points = anchor.points(grid.lonlat(np.column_stack([x.ravel(), y.ravel()])))
    interpolated = BodyTile(grid, z, column, row).points(FrameLocation("site", body("mars"), anchor))
    errors = np.hypot(interpolated[0].ravel() - points[:, 0], interpolated[1].ravel() - points[:, 1])
    assert errors.max() < 0.01 * grid.cell_m(z)
    window = hills(-200, 400)
    rows, cols, inside = window.geometry.cells_of(points[:, 0], points[:, 1])
    expected = np.where(inside, window.layer("mean")[rows, cols], np.nan).reshape(256, 256)
    known = np.isfinite(values) & np.isfinite(expected)
    assert known.mean() > 0.02
    assert np.abs(values[known] - expected[known]).max() < 0.4  # neighbouring cells differ by this
    assert np.median(np.abs(values[known] - expected[known])) < 0.02
    with MemoryFile(http.get(f"{path}.tif?grid={grid.name}").content) as memory, memory.open() as file:
        assert file.crs.to_authority() == ("IAU_2015", "49910")
        assert tuple(file.bounds) == pytest.approx(tuple(geometry.bounds), abs=1e-3)
    assert http.get(f"{path}.png?grid=IAU_2015_30110").status_code == 422
    whole = http.get(f"/tiles/elevation/0/0/0.png?grid={grid.name}")
    assert whole.status_code == 200
    empty = pixels(http.get(f"/tiles/hillshade/8/0/0.png?grid={grid.name}").content)
    assert not empty[..., 3].any()


def test_tiles_finer_than_the_maps_show_their_cells_enlarged(http: TestClient, dpm: Dpm) -> None:
    put_hills(dpm)
    columns, rows = tiles_over(17, (1.0, 1.0, 1.0, 1.0))
    coarse = values_of(http, f"/tiles/elevation/17/{columns[0]}/{rows[0]}.bin")
    fine = np.block(
        [
            [
                values_of(http, f"/tiles/elevation/18/{2 * columns[0] + x}/{2 * rows[0] + y}.bin")
                for x in (0, 1)
            ]
            for y in (0, 1)
        ]
    )
    np.testing.assert_array_equal(fine, np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1))
    columns, rows = tiles_over(20, (1.0, 1.0, 1.0, 1.0))
    assert np.isfinite(values_of(http, f"/tiles/elevation/20/{columns[0]}/{rows[0]}.bin")).all()
    for layer in ("hillshade", "dem", "slope"):
        assert pixels(http.get(f"/tiles/{layer}/20/{columns[0]}/{rows[0]}.png").content)[..., 3].mean() > 240


def test_tiles_show_the_maps_of_a_time_robot_and_quality(
    http: TestClient, dpm: Dpm, clock: ManualClock
) -> None:
    for seq, (robot, height_m, rms_m) in enumerate([("mana", 1.0, 0.1), ("minnie", 3.0, 0.5)], 1):
        quality = Quality(Status.OK, metrics={"rms_m": rms_m})
        value = elevation(0.0, height_m, seq * S, cells=20)
        arguments = put_arguments(value, "dem", seq, robot, resolution_m=0.1, quality=quality)
        dpm.writer.put(*arguments)
        clock.advance(1.0) if hasattr(clock, "advance") else clock.set_ns(101 * S)
    columns, rows = tiles_over(17, (1.0, 1.0, 1.0, 1.0))
    path = f"/tiles/elevation/17/{columns[0]}/{rows[0]}.bin"

    def height(**parameters: Any) -> float:
        return float(np.nanmean(values_of(http, path, **parameters)))

    assert height() == pytest.approx(2.0)
    assert height(robot="mana") == pytest.approx(1.0)
    assert height(t1=str(1 * S)) == height(time="1970-01-01T00:00:01Z") == pytest.approx(1.0)
    assert height(t0=str(2 * S)) == pytest.approx(3.0)
    assert height(time="1970-01-01T00:00:02Z/..") == pytest.approx(3.0)
    assert height(quality="rms_m<0.3") == pytest.approx(1.0)
    assert height(as_of=str(100 * S)) == pytest.approx(1.0)
    assert height(time="current") == pytest.approx(2.0)
    assert not np.isfinite(values_of(http, path, robot="other")).any()
    dpm.writer.put(*put_arguments(elevation(0.0, 5.0, S), "dem", 9, "mana", t1_ns=S, resolution_m=0.1))
    assert height(robot="mana") == pytest.approx(3.0)  # cached tiles are dropped
    for odd in ({"time": "yesterday"}, {"time": "1970-01-01T00:00:01Z", "t1": "1"}, {"robot": "Ä"}):
        assert http.get(path, params=odd).status_code == 422
    pairs = f"service=WMTS&request=GetTile&layer=elevation&tilematrix=17&tilerow={rows[0]}"
    url = f"/wmts?{pairs}&tilecol={columns[0]}&format=image/tiff&TIME="
    with MemoryFile(http.get(f"{url}1970-01-01T00:00:01Z").content) as memory, memory.open() as file:
        assert np.nanmean(file.read(1)) == pytest.approx(3.0)
    assert http.get(f"{url}yesterday").status_code == 400


def test_layers_have_a_legend(http: TestClient) -> None:
    for layer in http.get("/tiles").json()["items"]:
        low, *_, high = layer["colors"]
        assert low[0] < high[0]
        path = layer["legend"]
        picture = pixels(http.get(path).content)
        assert len(np.unique(picture[..., :3].reshape(-1, 3), axis=0)) > 3
    assert http.get("/tiles/nothing/legend.png").status_code == 404
    assert http.get("/tiles/dem/legend.png?low=2&high=1").status_code == 422


def test_the_wmts_document_of_an_anchored_frame_names_a_crs(http: TestClient, dpm: Dpm) -> None:
    dpm.store.anchors.anchor("site", Anchor(body("mars"), 77.45, 18.44))
    put_hills(dpm)
    root = ET.fromstring(http.get("/wmts").content)
    space = {"w": "http://www.opengis.net/wmts/1.0", "o": "http://www.opengis.net/ows/1.1"}
    crs = [e.text for e in root.findall(".//o:SupportedCRS", space)]
    assert crs[0] == "urn:ogc:def:crs:IAU_2015::49910"
    (box,) = root.findall(".//w:Layer[o:Identifier='dem']/o:BoundingBox", space)
    assert box.get("crs") == crs[0]
    west = float(str(box.findtext("o:LowerCorner", "", space)).split()[0])
    assert west == pytest.approx(np.radians(77.45) * 3_396_190.0, abs=100.0)
    assert root.findtext(".//w:Dimension/w:Default", "", space) == "current"
    assert http.get("/tiles/grid").json()["crs"] == "http://www.opengis.net/def/crs/IAU/2015/49910"
    assert http.get("/tiles/grid?frame=other").status_code == 422


def test_ogc_tiles_and_coverages_are_those_of_the_tiles_and_windows(http: TestClient, dpm: Dpm) -> None:
    anchor = Anchor(body("mars"), 77.45, 18.44)
    dpm.store.anchors.anchor("site", anchor)
    put_hills(dpm)
    links = {
        link["rel"].rsplit("/", 1)[-1]: link for link in http.get("/ogc/collections/dem").json()["links"]
    }
    sets = http.get(links["tilesets-map"]["href"]).json()["tilesets"]
    assert len(sets) == 2 * sum(product == "dem" for product in LAYERS.values())
    first = sets[0]
    assert first["crs"] == "http://www.opengis.net/def/crs/IAU/2015/49910"
    for link in first["links"]:
        if "templated" not in link:
            assert http.get(link["href"]).status_code == 200
    columns, rows = tiles_over(17, (1.0, 1.0, 1.0, 1.0))
    in_frame = next(s for s in sets if s["title"] == "elevation in grid")
    (template,) = [link["href"] for link in in_frame["links"] if link.get("type") == "image/png"]
    url = template.replace("{tileMatrix}", "17").replace("{tileRow}", str(rows[0]))
    url = url.replace("{tileCol}", str(columns[0]))
    assert http.get(url).content == http.get(f"/tiles/elevation/17/{columns[0]}/{rows[0]}.png").content
    assert http.get(f"{url}&time=1960-01-01T00:00:00Z").status_code == 200
    (west, south, _), (east, north, _) = anchor.lonlat([[1.0, 1.0], [4.0, 3.0]])
    window = {"bbox": f"{west},{south},{east},{north}"}
    answer = http.get(links["coverage"]["href"], params=window)
    assert answer.status_code == 200, answer.text
    with MemoryFile(answer.content) as memory, memory.open() as file:
        assert (file.width, file.height) == (30, 20)
        assert file.descriptions[:2] == ("mean", "variance")
        assert np.isfinite(file.read(1)).mean() > 0.9
    coarse = http.get(links["coverage"]["href"], params=window | {"resolution_m": 0.5})
    with MemoryFile(coarse.content) as memory, memory.open() as file:
        assert file.res == pytest.approx((0.5, 0.5))
    assert http.get("/ogc/collections/dem/coverage").status_code == 200
    for odd in ("bbox=1,2,3", "bbox=5,0,4,1", "bbox=77,18,78,nan", "bbox="):
        assert http.get(f"/ogc/collections/dem/coverage?{odd}").status_code == 400
    assert http.get("/ogc/collections/dem/coverage?bbox=0,0,1,1").status_code == 404
    assert http.get("/ogc/collections/pose/coverage?bbox=0,0,1,1").status_code == 404
    assert http.get("/ogc/tileMatrixSets/nothing").status_code == 404
