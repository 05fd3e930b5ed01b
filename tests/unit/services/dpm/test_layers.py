# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Map layers by name: windows, profiles, tiles, and the codes of refusals."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
import pytest

from cdff_common.formats.file_source import load
from cdff_common.formats.geotiff import read_bands
from cdff_common.raster.rendering import CLASS_COLORS, RENDERINGS
from cdff_common.raster.tiles import tiles_over
from cdff_common.types import NavigationMap
from services.dpm.http.routes.layers import LAYERS
from services.dpm.operations.dpm import Dpm

from .conftest import S, TestClient, elevation, navigation, put_arguments
from .test_tiles import pixels, put_hills

MAPS = "/api/v1/maps"
REGION = {"region": "bbox:-5,0,5,8"}


def test_layers_list_their_content_with_links(http: TestClient, inserted_id: Callable[[str], str]) -> None:
    items = {item["layer"]: item for item in http.get(MAPS).json()["items"]}
    assert set(items) == set(LAYERS)
    (stored,) = items["slope"]["frames"]
    assert (stored["frame"], stored["resolution_m"], stored["newest_ns"], stored["count"]) == (
        "site",
        0.1,
        "0",
        1,
    )
    assert stored["box_m"] == pytest.approx([0, 0, 0, 2, 2, 0])
    for name, item in items.items():
        assert http.get(f"{MAPS}/{name}").json() == item
        for kind in ("self", "products", "window"):
            if kind in item["links"]:
                assert http.get(item["links"][kind]).status_code == 200
        if "profile" in item["links"]:
            assert http.get(item["links"]["profile"], params={"path": "0.5,0.5,1.5,0.5"}).json()["mean_m"]
        if "tiles" in item["links"]:
            assert http.get(item["links"]["tiles"].format(z=0, x=0, y=0)).status_code == 200


@pytest.mark.parametrize("layer", RENDERINGS)
def test_a_window_of_a_layer_is_an_image_or_values(http: TestClient, dpm: Dpm, layer: str) -> None:
    put_hills(dpm)
    image = http.get(f"{MAPS}/{layer}/window", params=REGION)
    assert (image.status_code, image.headers["content-type"]) == (200, "image/png")
    assert image.headers["cdff-coverage"] == "1.0000"
    assert pixels(image.content).shape == (80, 100, 4)
    raster = http.get(f"{MAPS}/{layer}/window", params=REGION | {"format": "tif"})
    bands, (resolution_m, xmin_m, ymax_m), _ = read_bands(load(raster.content))
    assert (resolution_m, xmin_m, ymax_m) == pytest.approx((0.1, -5.0, 8.0))
    elevation_window = np.load(
        io.BytesIO(http.get(f"{MAPS}/dem/window", params=REGION | {"format": "npz"}).content)
    )
    mean, variance = (
        np.pad(elevation_window[name], 1, constant_values=np.nan) for name in ("mean", "variance")
    )
    np.testing.assert_array_equal(bands[layer], RENDERINGS[layer].value(mean, variance, 0.1))
    assert np.isfinite(bands[layer][1:-1, 1:-1]).all()


@pytest.mark.parametrize("path", ["soil", "soil/window", "soil/profile"])
def test_an_unknown_layer_is_refused_with_the_known_ones(http: TestClient, path: str) -> None:
    answer = http.get(f"{MAPS}/{path}")
    assert (answer.status_code, answer.json()["code"]) == (404, "NOT_FOUND")
    assert ", ".join(LAYERS) in answer.json()["detail"]


@pytest.mark.parametrize("path", ["navigation_map/profile?path=0,0,1,1", "slope/profile?path=0,0,1,1"])
def test_a_profile_of_a_layer_without_heights_is_not_found(http: TestClient, path: str) -> None:
    assert http.get(f"{MAPS}/{path}").json()["code"] == "NOT_FOUND"


@pytest.mark.parametrize("query", ["low=3&high=2", "format=jpg", "low=nan", "choice=any"])
def test_a_window_that_cannot_be_drawn_is_refused(http: TestClient, dpm: Dpm, query: str) -> None:
    dpm.writer.put(*put_arguments(elevation(0.0), "dem", 1))
    assert http.get(f"{MAPS}/slope/window?{query}").status_code == 422


@pytest.mark.parametrize(
    ("method", "path", "headers", "status", "code"),
    [
        ("GET", "/nowhere", {}, 404, "NOT_FOUND"),
        ("GET", "/static/x", {}, 404, "NOT_FOUND"),
        ("PUT", "/api/v1/products", {}, 405, "INVALID_ARGUMENT"),
        ("PATCH", "{dem}", {}, 428, "INVALID_ARGUMENT"),
        ("PATCH", "{dem}", {"If-Match": '"r7"'}, 412, "CONFLICT"),
        ("PATCH", "{dem}", {"If-Match": 'W/"r0"'}, 412, "CONFLICT"),
        ("DELETE", "{dem}", {"If-Match": 'W/"r0"'}, 412, "CONFLICT"),
        ("GET", "{dem}/payload", {"Range": "bytes=9999999-"}, 416, "INVALID_ARGUMENT"),
    ],
)
def test_every_refusal_has_a_code(
    http: TestClient,
    inserted_id: Callable[[str], str],
    method: str,
    path: str,
    headers: dict[str, str],
    status: int,
    code: str,
) -> None:
    url = path.format(dem=f"/api/v1/products/{inserted_id('dem')}")
    answer = http.request(method, url, headers=headers, json={"notes": "x"} if method == "PATCH" else None)
    assert (answer.status_code, answer.json()["code"]) == (status, code)


@pytest.mark.req("CDFF-SUP-184")
def test_navigation_maps_are_fused_by_the_selected_rule(http: TestClient, dpm: Dpm) -> None:
    dpm.writer.put(*put_arguments(navigation(), "navigation_map", 1, resolution_m=0.1))
    safe = NavigationMap.from_layers(
        navigation().geometry, {"class": np.ones((10, 10), np.uint8)}, t0_ns=2 * S, t1_ns=2 * S
    )
    dpm.writer.put(*put_arguments(safe, "navigation_map", 2, resolution_m=0.1))
    for choice, hazards in (("newest", 0), ("oldest", 50), ("worst", 50)):
        answer = http.get(f"{MAPS}/navigation_map/window?region=bbox:0,0,1,1&format=npz&choice={choice}")
        assert answer.status_code == 200, answer.text
        assert (np.load(io.BytesIO(answer.content))["class"] == 3).sum() == hazards
        assert (answer.headers["CDFF-Patches"], answer.headers["CDFF-Disagreeing"]) == ("2", "50")
    for form in ("tif", "png", "geojson"):
        assert http.get(f"{MAPS}/navigation_map/window?format={form}").status_code == 200
    assert http.get(f"{MAPS}/cost/window").status_code == 200
    for wrong in ("choice=pooled", "disagreement=drop", "choice=best"):
        assert http.get(f"{MAPS}/navigation_map/window?{wrong}").status_code == 422


@pytest.mark.req("CDFF-SUP-184")
def test_a_tile_of_navigation_maps_is_rendered_again_after_an_insertion(http: TestClient, dpm: Dpm) -> None:
    dpm.writer.put(*put_arguments(navigation(), "navigation_map", 1, resolution_m=0.1))
    columns, rows = tiles_over(17, (0.5, 0.5, 0.5, 0.5))
    tile = f"/tiles/navigation_map/17/{columns[0]}/{rows[0]}"
    values = np.frombuffer(http.get(f"{tile}.bin").content, "<f4")
    assert (np.isfinite(values).sum(), (values == 3).sum()) == (100, 50)
    first_image = http.get(f"{tile}.png")
    rgba = pixels(first_image.content).reshape(-1, 4)
    assert {tuple(c) for c in np.unique(rgba[rgba[:, 3] > 0], axis=0)} == {
        tuple(CLASS_COLORS[c]) for c in (1, 3)
    }
    assert http.get(f"{tile}.png?low=0").status_code == 422
    dpm.writer.put(*put_arguments(elevation(0.0), "dem", 3, resolution_m=0.1))
    assert http.get(f"{tile}.png").headers["ETag"] == first_image.headers["ETag"]
    safe = NavigationMap.from_layers(
        navigation().geometry, {"class": np.ones((10, 10), np.uint8)}, t0_ns=4 * S, t1_ns=4 * S
    )
    dpm.writer.put(*put_arguments(safe, "navigation_map", 4, resolution_m=0.1))
    assert http.get(f"{tile}.png").headers["ETag"] != first_image.headers["ETag"]
