# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Analyses of heights over HTTP and as tiles, on simulated ground."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
import pytest
from rasterio.io import MemoryFile

from cdff_common.errors import ProductNotFoundError, UnavailableError
from cdff_common.geodesy import Anchor, body
from cdff_common.raster import GridGeometry
from cdff_common.raster.tiles import Tile, tiles_over
from cdff_common.types import ElevationMap
from services.dpm.operations.dpm import Dpm
from services.dpm.rendering.tile_cells import TileAnalysis
from services.dpm.rendering.tiles import TileRequest

from .conftest import S, TestClient, put_arguments

MAPS = "/api/v1/maps/dem"
REGION = "bbox:-5,-5,5,5"


def ground(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the height of the ground, metres."""
    return 0.1 * x + 0.2 * np.sin(y)


def put_ground(dpm: Dpm, second: int, raised_m: float = 0.0, sigma_m: float = 0.01) -> None:
    """Insert 20 m x 20 m of the ground with noise in two patches; x between 0 and 2 m is raised."""
    for seq, top_m in enumerate((10.0, 0.0), 2 * second):
        put_strip(dpm, GridGeometry("site", 0.1, -10.0, top_m, 100, 200), seq, second, raised_m, sigma_m)


def put_strip(
    dpm: Dpm,
    geometry: GridGeometry,
    seq: int,
    second: int,
    raised_m: float,
    sigma_m: float,
    has_pose_variance: bool = True,
) -> None:
    """Insert one patch of the ground."""
    x, y = geometry.centres_m()
    raised = np.where((x > 0.0) & (x < 2.0), raised_m, 0.0)
    mean = ground(x, y) + raised + np.random.default_rng(seq).normal(0.0, sigma_m, x.shape)
    ones = np.ones_like(mean)
    layers = {
        "mean": mean,
        "variance": ones * sigma_m**2,
        "min": mean,
        "max": mean,
        "count": ones,
        "age_s": ones * 0,
        "pose_variance": ones * 1e-6,
        "first_age_s": ones * 0,
    }
    if not has_pose_variance:
        del layers["pose_variance"]
    single = {name: values.astype(np.float32) for name, values in layers.items()}
    value = ElevationMap.from_layers(geometry, single, t0_ns=second * S, t1_ns=second * S)
    dpm.writer.put(*put_arguments(value, "dem", seq, t1_ns=second * S, resolution_m=0.1))


def arrays(http: TestClient, analysis: str, **parameters: object) -> dict[str, np.ndarray]:
    """Return the arrays of an analysis."""
    answer = http.get(f"{MAPS}/{analysis}", params={"format": "npz", **parameters})
    assert answer.status_code == 200, answer.text
    return dict(np.load(io.BytesIO(answer.content)))


def test_a_slope_has_the_margin_of_its_region_and_its_error(http: TestClient, dpm: Dpm) -> None:
    put_ground(dpm, 1)
    result = arrays(http, "surface", region=REGION, baseline_m=0.9)
    geometry = GridGeometry("site", 0.1, *result["corner_m"], *result["slope_deg"].shape)
    assert geometry.bounds == pytest.approx((-5.0, -5.0, 5.0, 5.0))
    _, y = geometry.centres_m()
    expected = np.degrees(np.arctan(np.hypot(0.1, 0.2 * np.cos(y))))
    error = result["slope_deg"] - expected
    assert np.isfinite(error).all()
    assert np.std(error / result["slope_sigma_deg"]) == pytest.approx(1.0, abs=0.5)
    assert np.abs(error).mean() < 0.5
    outside = arrays(http, "surface", region="circle:0,0,3")["slope_deg"]
    assert np.isnan(outside[0, 0])


@pytest.mark.parametrize("resolution_m", [0.1, 0.2, 0.5, 1.0])
def test_the_error_of_elevation_in_larger_cells_is_not_understated(
    http: TestClient, dpm: Dpm, resolution_m: float
) -> None:
    put_ground(dpm, 1, sigma_m=0.05)
    params = {"region": "bbox:-9,-9,9,9", "resolution_m": resolution_m, "format": "npz"}
    layers = np.load(io.BytesIO(http.get(f"{MAPS}/window", params=params).content))
    geometry = GridGeometry("site", resolution_m, -9.0, 9.0, *layers["mean"].shape)
    error = layers["mean"] - ground(*geometry.centres_m())
    ratio = 1.0 / np.sqrt(np.mean(error**2 / layers["error_variance"]))
    print(f"cells of {resolution_m} m: stated standard deviation / error = {ratio:.2f}")
    assert 0.95 < ratio < 1.8


def test_a_viewshed_is_a_geotiff_around_the_observer(http: TestClient, dpm: Dpm) -> None:
    put_ground(dpm, 1, raised_m=3.0)
    dpm.store.anchors.anchor("site", Anchor(body("mars"), 77.45, 18.44))
    answer = http.get(f"{MAPS}/viewshed", params={"observer": "-3,0", "range_m": 8})
    assert answer.headers["content-type"].startswith("image/tiff")
    with MemoryFile(answer.content) as memory, memory.open() as file:
        assert file.descriptions == ("visible", "hidden_m", "hidden_sigma_m", "unobserved")
        assert "mars" in file.crs.to_wkt()
        visible = dict(zip(("before", "behind"), (v[0] for v in file.sample([(-1, 0), (4, 0)])), strict=True))
    assert visible["before"] > 0.99
    assert visible["behind"] < 0.01
    refused = http.get(f"{MAPS}/viewshed", params={"observer": "-300,0"})
    assert refused.status_code == 404


def test_a_difference_is_significant_where_the_ground_changed(http: TestClient, dpm: Dpm) -> None:
    put_ground(dpm, 1)
    put_ground(dpm, 50, raised_m=0.3)
    result = arrays(http, "difference", region=REGION, since=str(20 * S))
    geometry = GridGeometry("site", 0.1, *result["corner_m"], *result["difference_m"].shape)
    x, _ = geometry.centres_m()
    changed = (x > 0.0) & (x < 2.0)
    assert result["difference_m"][changed].mean() == pytest.approx(0.3, abs=0.003)
    assert np.abs(result["difference_m"][~changed]).mean() < 0.02
    inner = (x > 0.15) & (x < 1.85)
    assert (result["significance"][inner] > 3.0).mean() > 0.99
    assert (result["significance"][(x < -0.3) | (x > 2.3)] > 3.0).mean() < 0.02
    metadata = dpm.terrain.run("difference", {"region": REGION, "since": str(20 * S)}).metadata
    assert metadata["raised_m3"] == pytest.approx(0.3 * 20.0, rel=0.05)
    assert metadata["earlier"]["newest_ns"] == S
    late = http.get(f"{MAPS}/difference", params={"since": str(60 * S), "region": REGION})
    assert late.status_code == 404


def put_square(dpm: Dpm, second: int, left_m: float = -5.0, **options: Any) -> None:
    """Insert 10 m x 10 m of the ground in one patch."""
    geometry = GridGeometry("site", 0.1, left_m, 5.0, 100, 100)
    put_strip(dpm, geometry, 1000 + second, second, options.pop("raised_m", 0.0), 0.01, **options)


def difference(dpm: Dpm, **parameters: object) -> dict[str, Any]:
    """Return the metadata of the difference of the captures until 20 s and later."""
    return dict(dpm.terrain.run("difference", {"since": str(20 * S), **parameters}).metadata)


def test_the_coverage_of_a_difference_is_that_of_its_region_in_both_maps(dpm: Dpm) -> None:
    put_square(dpm, 1, left_m=-5.0)
    put_square(dpm, 50, left_m=0.0)
    assert difference(dpm, region="circle:2.5,0,2")["coverage"] == 1.0
    assert difference(dpm, region="circle:0,0,2")["coverage"] == pytest.approx(0.5, abs=0.01)
    assert difference(dpm)["coverage"] == pytest.approx(5.0 / 15.0)
    with pytest.raises(UnavailableError, match=r"coverage 0\.333 of the region, asked 0\.400"):
        difference(dpm, min_coverage=0.4)


def test_a_difference_without_errors_has_no_area_of_change(dpm: Dpm) -> None:
    put_square(dpm, 1, left_m=-10.0, has_pose_variance=False)
    put_square(dpm, 50, raised_m=0.5)
    unknown = difference(dpm, region="bbox:-4,-4,0,4")
    assert [unknown[name] for name in ("changed_m2", "raised_m3", "lowered_m3")] == [None, None, None]
    assert unknown["unknown_error_m2"] == pytest.approx(32.0)
    put_square(dpm, 2, left_m=0.0)
    partly_known = difference(dpm, region="bbox:-4,-4,4,4")
    assert partly_known["changed_m2"] == pytest.approx(16.0, rel=0.05)
    assert partly_known["raised_m3"] == pytest.approx(8.0, rel=0.05)
    assert partly_known["unknown_error_m2"] == pytest.approx(32.0)


def test_a_limit_of_the_newest_capture_applies_to_the_later_heights_of_a_difference(dpm: Dpm) -> None:
    put_square(dpm, 1)
    put_square(dpm, 50, raised_m=0.5)
    for limit in ({"newest_after": str(30 * S)}, {"max_age_s": 60}):
        assert difference(dpm, **limit)["earlier"]["newest_ns"] == S
    with pytest.raises(ProductNotFoundError, match="expected 60000000000 or later"):
        difference(dpm, newest_after=str(60 * S))


@pytest.mark.parametrize("observer", ["5,0", "0,5", "5,5", "-5,-5", "0,-5"])
@pytest.mark.parametrize("region", [None, "bbox:-5,-5,5,5"])
def test_an_observer_may_stand_on_the_edge_of_the_map(
    http: TestClient, dpm: Dpm, observer: str, region: str | None
) -> None:
    put_square(dpm, 1)
    parameters = {} if region is None else {"region": region}
    visible = arrays(http, "viewshed", observer=observer, range_m=2, **parameters)["visible"]
    assert np.nanmax(visible) > 0.999
    x, y = (float(v) for v in observer.split(","))
    columns, rows = tiles_over(17, (0.98 * x, 0.98 * y, 0.98 * x, 0.98 * y))
    tile = tile_values(dpm, "viewshed", Tile(17, columns[0], rows[0]), observer_m=(x, y))
    assert np.nanmax(tile) == 1.0


def test_contours_are_lines_in_the_crs_of_the_body(http: TestClient, dpm: Dpm) -> None:
    put_ground(dpm, 1, sigma_m=1e-4)
    answer = http.get(f"{MAPS}/contours", params={"region": REGION, "interval_m": 0.1})
    assert answer.headers["content-type"] == "application/geo+json"
    document = json.loads(answer.content)
    assert "site" in document["crs"]["properties"]["name"]
    for item in document["features"]:
        points = np.concatenate([np.array(line) for line in item["geometry"]["coordinates"]])
        assert ground(*points.T) == pytest.approx(item["properties"]["height_m"], abs=0.01)
        assert item["properties"]["sigma_m"] > 0.0
    assert len(document["features"]) >= 10


def test_statistics_of_a_polygon_state_volumes_and_errors(http: TestClient, dpm: Dpm) -> None:
    put_ground(dpm, 1)
    triangle = "polygon:0,0,4,0,0,4"
    answer = http.get(f"{MAPS}/statistics", params={"region": triangle, "datum_m": -1})
    assert answer.status_code == 200, answer.text
    result = answer.json()
    assert result["area_m2"] == pytest.approx(8.0, rel=0.03)
    assert result["coverage"] == 1.0
    rng = np.random.default_rng(0)
    u, v = rng.uniform(size=(2, 200_000)) * 4.0
    inside = ground(u, v)[u + v < 4.0]
    assert result["height_m"]["mean"] == pytest.approx(inside.mean(), abs=0.005)
    assert result["volume_above_m3"] == pytest.approx((inside.mean() + 1.0) * 8.0, rel=0.03)
    assert 1e-3 <= result["mean_sigma_m"] < 2e-3  # that of the pose is 1 mm
    assert http.get(f"{MAPS}/statistics").status_code == 422


def tile_values(dpm: Dpm, layer: str, tile: Tile, **parameters: object) -> np.ndarray:
    """Return the values of a tile."""
    analysis = TileAnalysis(**parameters)  # type: ignore[arg-type]
    rendered = dpm.tiles.get(TileRequest("site", layer, tile, "bin", analysis=analysis))
    return np.frombuffer(rendered.data, "<f4").reshape(256, 256)


def test_tiles_of_analyses_have_the_values_of_their_windows(http: TestClient, dpm: Dpm) -> None:
    put_ground(dpm, 1)
    put_ground(dpm, 50, raised_m=0.5)
    columns, rows = tiles_over(17, (1.0, 1.0, 1.0, 1.0))
    tile = Tile(17, columns[0], rows[0])
    x, y = tile.geometry("site").centres_m()
    known = (np.abs(x) < 9.0) & (np.abs(y) < 9.0)
    change = tile_values(dpm, "difference", tile, since_ns=20 * S)
    raised = known & (x > 0.2) & (x < 1.8)
    assert change[raised].mean() == pytest.approx(0.5, abs=0.01)
    assert np.abs(change[known & (x > 2.2)]).mean() < 0.02
    lines = tile_values(dpm, "contours", tile, interval_m=0.25)
    assert 0.01 < np.isfinite(lines[known]).mean() < 0.5
    visibility = tile_values(dpm, "viewshed", tile, observer_m=(5.0, 1.0), observer_height_m=1.0, range_m=9.0)
    assert visibility[known & (np.abs(x - 4.5) < 0.2) & (np.abs(y - 1.0) < 0.2)].min() == 1.0
    rough = tile_values(dpm, "roughness", tile)
    assert 0.0 < np.nanmedian(rough[known & (x > 3.0)]) < 0.02
    put_ground(dpm, 60, raised_m=9.0)
    again = tile_values(dpm, "viewshed", tile, observer_m=(5.0, 1.0), observer_height_m=1.0, range_m=9.0)
    assert not np.array_equal(visibility, again, equal_nan=True)


def test_tiles_of_a_viewshed_enlarge_the_cells_of_the_map(dpm: Dpm) -> None:
    put_ground(dpm, 1)
    parameters = {"observer_m": (5.01, 1.01), "observer_height_m": 1.0, "range_m": 9.0}
    tile_by_level = {}
    for z in (17, 19):
        columns, rows = tiles_over(z, (5.0, 1.0, 5.0, 1.0))
        tile = Tile(z, columns[0], rows[0])
        tile_by_level[z] = tile.geometry("site"), tile_values(dpm, "viewshed", tile, **parameters)
    (coarse, expected), (fine, enlarged) = tile_by_level[17], tile_by_level[19]
    rows_of, columns_of, inside = coarse.cells_of(*fine.centres_m())
    assert inside.all()
    assert np.array_equal(enlarged, expected[rows_of, columns_of], equal_nan=True)
    assert np.isfinite(enlarged).mean() > 0.9


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ("viewshed/17/65536/65535.png", "layer viewshed without observer"),
        ("difference/17/65536/65535.png", "layer difference without since"),
        ("slope/17/65536/65535.png?since=1000", "layer slope has no such parameter"),
        ("contours/17/65536/65535.png?interval_m=1&observer=1,2", "layer contours has no such parameter"),
        ("viewshed/17/65536/65535.png?observer=1", "expected x,y"),
    ],
)
def test_parameters_of_analyses_are_checked(http: TestClient, dpm: Dpm, query: str, message: str) -> None:
    answer = http.get(f"/tiles/{query}")
    assert (answer.status_code, answer.json()["code"]) == (422, "INVALID_ARGUMENT")
    assert message in answer.json()["detail"]


def test_pictures_of_analyses_have_legends(http: TestClient, dpm: Dpm) -> None:
    put_ground(dpm, 1)
    for layer, query in (("contours", "interval_m=0.5"), ("viewshed", "observer=1,1")):
        assert http.get(f"/tiles/{layer}/17/65536/65535.png?{query}").headers["content-type"] == "image/png"
        assert http.get(f"/tiles/{layer}/legend.png").status_code == 200
    wmts = "/wmts?REQUEST=GetTile&LAYER=contours&TILEMATRIX=17&TILEROW=65535&TILECOL=65536&INTERVAL_M=0.5"
    assert http.get(wmts).headers["content-type"] == "image/png"


def test_an_unknown_analysis_is_named(dpm: Dpm) -> None:
    from cdff_common.errors import InputError

    with pytest.raises(InputError, match="expected one of contours, difference"):
        dpm.terrain.run("gloss", {})
