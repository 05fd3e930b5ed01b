# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""STAC and OGC API Features: unanchored sites, antimeridian, two sites of a body, ETags, ranges."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely
from fastapi.testclient import TestClient

from cdff_common.geodesy import Anchor, body
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import Pointcloud
from dpm_store.frames import frames
from services.dpm.http.geographic_outlines import MAX_CORNERS, cut_at_antimeridian, enclosing
from services.dpm.http.middleware.conditional import matches
from services.dpm.http.ogc.crs import CrsList
from services.dpm.http.routes import products
from services.dpm.operations.dpm import Dpm

from .conftest import elevation, put_arguments

InsertedId = Callable[[str], str]
MARS = body("mars")


def feature_ids(http: TestClient, path: str) -> list[str]:
    answer = http.get(path)
    assert answer.status_code == 200, answer.text
    return [feature["id"] for feature in answer.json()["features"]]


def test_without_an_anchor_products_are_listed_without_geometry(
    http: TestClient, inserted_id: InsertedId
) -> None:
    for path in ("/stac/collections/dem/items", "/ogc/collections/dem/items", "/stac/search?collections=dem"):
        (feature,) = http.get(path).json()["features"]
        assert (feature["id"], feature["geometry"]) == (inserted_id("dem"), None)
    assert feature_ids(http, "/stac/search?bbox=-180,-90,180,90") == []
    collection = http.get("/ogc/collections/dem").json()
    assert collection["crs"] == []
    assert "spatial" not in collection["extent"]
    assert (
        http.get("/ogc/collections/dem/items?crs=http://www.opengis.net/def/crs/IAU/2015/49900").status_code
        == 400
    )
    assert http.get("/ogc/crs/mars_lonlat").status_code == 404


def test_products_of_an_anchored_site_have_a_geometry(
    http: TestClient, dpm: Dpm, inserted_id: InsertedId
) -> None:
    dpm.store.anchors.anchor("site", Anchor(MARS, 10.0, 0.0))
    assert set(feature_ids(http, "/stac/search?bbox=9.99,-0.01,10.01,0.01")) == {
        inserted_id(k) for k in ("dem", "navigation_map", "pointcloud", "pose")
    }
    dpm.store.anchors.anchor("site", Anchor(MARS, 20.0, 0.0))
    assert feature_ids(http, "/stac/search?bbox=9.99,-0.01,10.01,0.01") == []
    assert inserted_id("dem") in feature_ids(http, "/ogc/collections/dem/items?bbox=19.99,-0.01,20.01,0.01")


@pytest.mark.parametrize("position_m", [0.0, 1e12, 1e155, 1e300])
def test_an_unanchored_frame_does_not_hide_other_products(
    http: TestClient, dpm: Dpm, inserted_id: InsertedId, monkeypatch: pytest.MonkeyPatch, position_m: float
) -> None:
    monkeypatch.setattr(
        frames, "FARTHEST_FRAME_M", np.inf
    )  # as in a store that was filled before frames at such distances were refused
    T = se3.transform(np.eye(3), [position_m, 0.0, position_m])
    dpm.store.frames.set("site", "mars", UncertainTransform(T))
    for path in ("/stac/search?collections=dem", "/ogc/collections/dem/items"):
        assert feature_ids(http, path) == [inserted_id("dem")]
    for path in (
        "/stac",
        "/ogc/collections",
        "/api/v1/places/site",
        "/api/v1/frames",
        "/tiles/wmts.xml",
        "/api/v1/maps/dem/window",
        "/stac/search?bbox=0,0,1,1",
    ):
        assert http.get(path).status_code == 200


def test_a_site_on_the_antimeridian_is_found_from_both_sides(http: TestClient, dpm: Dpm) -> None:
    dpm.store.anchors.anchor("site", Anchor(MARS, 180.0, 0.0))
    _, west = dpm.writer.put(*put_arguments(elevation(-100.0), "dem", 1, resolution_m=0.1))
    _, crossing = dpm.writer.put(*put_arguments(elevation(-1.0), "dem", 2, resolution_m=0.1))
    _, east = dpm.writer.put(*put_arguments(elevation(100.0), "dem", 3, resolution_m=0.1))
    assert set(feature_ids(http, "/stac/search?bbox=179.99,-1,-179.99,1")) == {west.id, crossing.id, east.id}
    assert set(feature_ids(http, "/stac/search?bbox=179,-1,180,1")) == {west.id, crossing.id}
    assert set(feature_ids(http, "/stac/search?bbox=-180,-1,-179,1")) == {crossing.id, east.id}
    geometry = http.get(f"/stac/collections/dem/items/{crossing.id}").json()["geometry"]
    assert geometry["type"] == "MultiPolygon"
    assert shapely.geometry.shape(geometry).is_valid


def test_two_sites_of_one_body_are_both_found(http: TestClient, dpm: Dpm) -> None:
    dpm.store.anchors.anchor("site", Anchor(MARS, 10.0, 0.0))
    dpm.store.anchors.anchor("mana/camp", Anchor(MARS, 11.0, 0.0))
    _, at_site = dpm.writer.put(*put_arguments(elevation(0.0), "dem", 1, resolution_m=0.1))
    value = Pointcloud.from_points(np.zeros((3, 3)), frame="mana/camp", stamp_ns=0)
    _, at_camp = dpm.writer.put(
        *put_arguments(value, "pointcloud", 2, frame="mana/camp", box_m=(0.0, 0.0, 0.0, 1.0, 1.0, 0.0))
    )
    assert feature_ids(http, "/stac/search?bbox=9.9,-0.1,10.1,0.1") == [at_site.id]
    assert feature_ids(http, "/stac/search?bbox=10.9,-0.1,11.1,0.1") == [at_camp.id]
    assert set(feature_ids(http, "/stac/search?bbox=0,-5,20,5")) == {at_site.id, at_camp.id}
    assert set(feature_ids(http, "/stac/search?bbox=-180,-90,180,90")) == {at_site.id, at_camp.id}


def test_products_on_other_bodies_have_coordinates_on_them(http: TestClient, dpm: Dpm) -> None:
    dpm.store.anchors.anchor("site", Anchor(MARS, 10.0, 0.0))
    dpm.store.anchors.anchor("moon/camp", Anchor(body("moon"), 10.0, 0.0))
    _, on_mars = dpm.writer.put(*put_arguments(elevation(0.0), "dem", 1, resolution_m=0.1))
    value = Pointcloud.from_points(np.zeros((3, 3)), frame="moon/camp", stamp_ns=0)
    _, on_moon = dpm.writer.put(
        *put_arguments(value, "pointcloud", 2, frame="moon/camp", box_m=(0.0, 0.0, 0.0, 10.0, 1.0, 0.0))
    )
    item = http.get(f"/stac/collections/pointcloud/items/{on_moon.id}").json()
    assert item["properties"]["ssys:targets"] == ["Moon"]
    assert item["properties"]["cdff:geographic_crs"] == "IAU_2015:30100"
    east_deg = np.degrees(10.0 / 1_737_400.0)
    assert np.allclose(item["bbox"][::2], [10.0, 10.0 + east_deg], rtol=0, atol=1e-9)
    mars = http.get(f"/stac/collections/dem/items/{on_mars.id}").json()
    assert mars["properties"]["ssys:targets"] == ["Mars"]
    assert set(feature_ids(http, "/stac/search?bbox=9.9,-0.1,10.1,0.1")) == {on_mars.id, on_moon.id}
    # All features of OGC API Features are in CRSs of Mars.
    assert feature_ids(http, "/ogc/collections/pointcloud/items?bbox=9.9,-0.1,10.1,0.1") == []
    (feature,) = http.get("/ogc/collections/pointcloud/items").json()["features"]
    assert feature["geometry"] is None


def test_a_box_around_two_near_sites_is_searched_in_one_pass(
    http: TestClient, dpm: Dpm, monkeypatch: pytest.MonkeyPatch
) -> None:
    dpm.store.anchors.anchor("site", Anchor(MARS, 10.0, 0.0))
    dpm.store.anchors.anchor("mana/camp", Anchor(MARS, 10.001, 0.0))
    ids = [
        dpm.writer.put(*put_arguments(elevation(10.0 * i), "dem", i + 1, resolution_m=0.1))[1].id
        for i in range(5)
    ]
    searches: list[object] = []
    search = dpm.store.search
    monkeypatch.setattr(dpm.store, "search", lambda query: (searches.append(query), search(query))[1])
    assert feature_ids(http, "/stac/search?bbox=10.5,0.5,10.6,0.6") == []
    assert len(searches) == 1
    assert set(feature_ids(http, "/stac/search?bbox=9.9,-0.1,10.1,0.1")) == set(ids)
    assert len(searches) == 2


def test_pages_of_a_box_over_distant_sites_repeat_and_skip_no_product(http: TestClient, dpm: Dpm) -> None:
    dpm.store.anchors.anchor("site", Anchor(MARS, 10.0, 0.0))
    dpm.store.anchors.anchor("mana/camp", Anchor(MARS, 40.0, 0.0))
    ids = []
    for i in range(7):
        frame = "site" if i % 2 else "mana/camp"
        value = Pointcloud.from_points(np.zeros((3, 3)), frame=frame, stamp_ns=0)
        arguments = put_arguments(
            value, "pointcloud", i + 1, frame=frame, box_m=(0.0, 0.0, 0.0, 1.0, 1.0, 0.0)
        )
        ids.append(dpm.writer.put(*arguments)[1].id)
    paged_ids: list[str] = []
    page = http.get("/stac/search?bbox=0,-5,60,5&limit=3").json()
    while True:
        paged_ids += [feature["id"] for feature in page["features"]]
        (*_, url) = [None, *(link["href"] for link in page["links"] if link["rel"] == "next")]
        if url is None:
            break
        page = http.get(url).json()
    assert sorted(paged_ids) == sorted(ids)
    assert paged_ids == [i.id for i in dpm.store.search().items]


@pytest.mark.parametrize(
    ("bbox", "is_found"),
    [
        ("9.9,-0.1,10.1,0.1", True),
        ("-350.1,-0.1,-349.9,0.1", True),  # the same place, one turn to the west
        ("9.9,-0.1,1010,10.1,0.1,1050", False),
        ("9.9,-0.1,990,10.1,0.1,1010", True),  # the site is 1000 m above the sphere
        ("9.9,-0.1,-10,10.1,0.1,900", False),
    ],
)
def test_a_box_may_have_heights_and_any_turn_of_longitude(
    http: TestClient, dpm: Dpm, bbox: str, is_found: bool
) -> None:
    dpm.store.anchors.anchor("site", Anchor(MARS, 10.0, 0.0, height_m=1000.0))
    _, product = dpm.writer.put(*put_arguments(elevation(0.0), "dem", 1, resolution_m=0.1))
    expected = [product.id] if is_found else []
    assert feature_ids(http, f"/stac/search?bbox={bbox}") == expected
    assert feature_ids(http, f"/ogc/collections/dem/items?bbox={bbox}") == expected


def test_the_whole_globe_contains_products_beyond_the_antimeridian_of_their_site(
    http: TestClient, dpm: Dpm
) -> None:
    dpm.store.anchors.anchor("site", Anchor(MARS, 179.999, 0.0))
    _, east = dpm.writer.put(*put_arguments(elevation(1000.0), "dem", 1, resolution_m=0.1))
    for bbox in ("-180,-90,180,90", "-180,-1,-179,1", "179,-1,181,1"):
        assert feature_ids(http, f"/stac/search?bbox={bbox}") == [east.id], bbox
    assert http.get("/stac/search?bbox=0,0,9,1,1,0").status_code == 400


@pytest.mark.parametrize(
    ("text", "status"),
    [
        ("1970-01-01t00:00:01z", 200),
        ("1970-01-01T00:00:01.123456789Z", 200),
        ("1970-01-01T00:00:01-00:00/..", 200),
        ("1937-01-01T12:00:27.87+0100", 400),
        ("1970-01-01T00:00:01.Z", 400),
        ("1970-01-01T00:00:01,5Z", 400),
        ("1970-01-01 00:00:01Z", 400),
        ("1970-01-01T00:00:01", 400),
        ("1000000000", 400),
        ("1970-01-01T00:00:02Z/1970-01-01T00:00:01Z", 400),
        ("../..", 400),
    ],
)
def test_times_of_a_search_are_those_of_rfc_3339(http: TestClient, text: str, status: int) -> None:
    assert http.get("/stac/search", params={"datetime": text}).status_code == status
    assert http.post("/stac/search", json={"datetime": text}).status_code == status


def test_the_first_page_states_the_number_of_all_products(http: TestClient, dpm: Dpm) -> None:
    dpm.store.anchors.anchor("site", Anchor(MARS, 10.0, 0.0))
    for i in range(5):
        dpm.writer.put(*put_arguments(elevation(2.0 * i), "dem", i + 1, resolution_m=0.1))
    for path in ("/stac/search?collections=dem&limit=2", "/ogc/collections/dem/items?limit=2"):
        assert http.get(path).json()["numberMatched"] == 5
    assert http.get("/stac/search?bbox=9,-1,11,1").json()["numberMatched"] == 5
    assert http.get("/stac/search?collections=pose").json()["numberMatched"] == 0


def test_items_of_a_collection_accept_its_own_name_only(http: TestClient, inserted_id: InsertedId) -> None:
    assert feature_ids(http, "/stac/collections/dem/items?collections=dem") == [inserted_id("dem")]
    assert http.get("/stac/collections/dem/items?collections=pose").status_code == 400


def test_the_interface_document_has_the_media_type_of_its_links(http: TestClient) -> None:
    (link,) = [link for link in http.get("/stac").json()["links"] if link["rel"] == "service-desc"]
    assert http.get(link["href"]).headers["content-type"] == link["type"]


def test_a_body_without_an_iau_code_has_its_own_crs(http: TestClient, dpm: Dpm) -> None:
    bennu = body("bennu")
    dpm.store.anchors.anchor("site", Anchor(bennu, 10.0, 5.0))
    dpm.writer.put(*put_arguments(elevation(0.0), "dem", 1, resolution_m=0.1))
    uris = http.get("/ogc/collections/dem").json()["crs"]
    assert uris == ["http://127.0.0.1:8080/ogc/crs/bennu_lonlat"]
    assert "ELLIPSOID" in http.get("/ogc/crs/bennu_lonlat").text
    (listed,) = http.get("/stac/collections/dem/items").json()["features"]
    item = http.get(f"/stac/collections/dem/items/{listed['id']}").json()
    assert item["properties"]["ssys:targets"] == ["Bennu"]
    assert item["properties"]["cdff:geographic_crs"] is None


def test_the_earth_has_the_crs_name_of_geojson() -> None:
    listed = CrsList(body("earth"), "http://x/ogc").uris
    assert any("IAU" in uri or "CRS84" in uri for uri in listed)


def test_an_outline_far_from_the_antimeridian_is_unchanged() -> None:
    square = shapely.box(10.0, 0.0, 11.0, 1.0)
    assert cut_at_antimeridian(square, 10.5).equals(square)
    parts = cut_at_antimeridian(shapely.box(179.0, 0.0, 181.0, 1.0), 180.0)
    assert parts.equals(
        shapely.union(shapely.box(179.0, 0.0, 180.0, 1.0), shapely.box(-180.0, 0.0, -179.0, 1.0))
    )


def test_an_outline_with_many_corners_is_enclosed_by_one_with_few() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    star = shapely.Polygon(
        np.column_stack([np.cos(angles), np.sin(angles)]) * (2 + np.cos(9 * angles))[:, None]
    )
    square = shapely.box(0.0, 0.0, 1.0, 1.0)
    around, same, none = enclosing([star, square, None])
    assert around is not None
    assert shapely.get_num_coordinates(around) <= MAX_CORNERS + 1
    assert around.buffer(1e-9).covers(star)
    assert around.area < 1.1 * star.convex_hull.area
    assert (same, none) == (square, None)


def test_features_filter_by_robot_and_status(http: TestClient, inserted_id: InsertedId) -> None:
    assert feature_ids(http, "/ogc/collections/dem/items?robot=mana&status=OK") == [inserted_id("dem")]
    assert feature_ids(http, "/ogc/collections/dem/items?robot=minnie") == []


@pytest.mark.parametrize("path", ["/stac", "/ogc/collections", "/api/v1/products", "/openapi.json"])
def test_an_unchanged_representation_is_answered_with_304(
    http: TestClient, inserted_id: InsertedId, path: str
) -> None:
    answer = http.get(path)
    etag = answer.headers["etag"]
    unchanged = http.get(path, headers={"If-None-Match": f'"other", {etag}'})
    assert (unchanged.status_code, unchanged.content) == (304, b"")
    assert http.get(path, headers={"If-None-Match": '"other"'}).status_code == 200


def test_changed_metadata_are_sent_again(http: TestClient, dpm: Dpm, inserted_id: InsertedId) -> None:
    url = f"/api/v1/products/{inserted_id('dem')}"
    etag = http.get(url).headers["etag"]
    assert http.get(url, headers={"If-None-Match": etag}).status_code == 304
    http.patch(url, json={"tags": ["a"]}, headers={"If-Match": etag})
    assert http.get(url, headers={"If-None-Match": etag}).status_code == 200


def test_converted_payloads_have_their_own_etag(http: TestClient, inserted_id: InsertedId) -> None:
    url = f"/api/v1/products/{inserted_id('dem')}/payload"
    etags = {
        http.get(url, params=p).headers["etag"]
        for p in ({}, {"format": "tif"}, {"format": "npz"}, {"as": "Map"})
    }
    assert len(etags) == 4
    tif = http.get(url, params={"format": "tif"}).headers["etag"]
    assert http.get(url, params={"format": "tif"}, headers={"If-None-Match": tif}).status_code == 304


def test_a_converted_payload_is_made_once_and_read_in_parts(
    http: TestClient, inserted_id: InsertedId, monkeypatch: pytest.MonkeyPatch
) -> None:
    converted_formats: list[str] = []
    convert = products.convert
    monkeypatch.setattr(
        products, "convert", lambda *a, **k: (converted_formats.append(a[3]), convert(*a, **k))[1]
    )
    url = f"/api/v1/products/{inserted_id('dem')}/payload?format=tif"
    whole = http.get(url)
    part = http.get(url, headers={"Range": "bytes=4-9"})
    assert (part.status_code, part.content) == (206, whole.content[4:10])
    assert part.headers["Content-Range"] == f"bytes 4-9/{len(whole.content)}"
    assert http.get(url, headers={"Range": "bytes=4-9", "If-Range": '"other"'}).content == whole.content
    assert http.get(url, headers={"Range": f"bytes={len(whole.content)}-"}).status_code == 416
    assert converted_formats == ["tif"]


def test_a_new_anchor_changes_the_etag_of_files_with_a_crs(
    http: TestClient, dpm: Dpm, inserted_id: InsertedId
) -> None:
    url = f"/api/v1/products/{inserted_id('dem')}/payload"
    before = {form: http.get(url, params={"format": form}).headers["etag"] for form in ("tif", "npz")}
    dpm.store.anchors.anchor("site", Anchor(MARS, 10.0, 0.0))
    after = {form: http.get(url, params={"format": form}).headers["etag"] for form in ("tif", "npz")}
    assert before["npz"] == after["npz"]
    assert before["tif"] != after["tif"]


def test_a_range_applies_to_the_payload_of_its_etag(http: TestClient, inserted_id: InsertedId) -> None:
    url = f"/api/v1/products/{inserted_id('pointcloud')}/payload"
    etag = http.get(url).headers["etag"]
    assert http.get(url, headers={"Range": "bytes=1-2", "If-Range": etag}).status_code == 206
    assert http.get(url, headers={"Range": "bytes=1-2", "If-Range": '"other"'}).status_code == 200


@pytest.mark.parametrize("path", ["/api/v1/status", "/stac", "/", "/healthz"])
def test_head_equals_get_without_the_body(http: TestClient, path: str) -> None:
    answer = http.head(path)
    assert (answer.status_code, answer.content) == (200, b"")
    assert int(answer.headers["content-length"]) > 0


def test_etags_are_compared_weakly() -> None:
    assert matches('W/"a"', '"a"')
    assert matches("*", '"a"')
    assert not matches('"b", "c"', '"a"')
    assert not matches(None, '"a"')


def test_items_link_the_inputs_that_exist_and_name_all(http: TestClient, dpm: Dpm) -> None:
    _, first = dpm.writer.put(*put_arguments(elevation(0.0), "dem", 1, resolution_m=0.1))
    _, gone = dpm.writer.put(*put_arguments(elevation(2.0), "dem", 2, resolution_m=0.1))
    sample = "6fad6a70-a6b6-55d2-86e7-c9e3d46a11f6"  # a sensor sample, which is never stored
    inputs = (first.id, gone.id, sample)
    _, merged = dpm.writer.put(*put_arguments(elevation(0.0), "dem", 3, resolution_m=0.1, inputs=inputs))
    dpm.writer.delete(gone.id)
    for path in (
        f"/stac/collections/dem/items/{merged.id}",
        f"/stac/search?ids={merged.id}&fields=properties",
    ):
        answer = http.get(path).json()
        (item,) = answer.get("features", [answer])
        links = [link["href"] for link in item["links"] if link["rel"] == "derived_from"]
        assert [http.get(href).status_code for href in links] == [200]
        assert links[0].endswith(first.id)
        assert item["properties"]["cdff:inputs"] == list(inputs)
