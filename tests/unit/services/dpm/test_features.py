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
from services.dpm.http.geographic_outlines import cut_at_antimeridian
from services.dpm.http.middleware.conditional import matches
from services.dpm.http.ogc.crs import CrsList
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


def test_a_body_without_an_iau_code_has_its_own_crs(http: TestClient, dpm: Dpm) -> None:
    bennu = body("bennu")
    dpm.store.anchors.anchor("site", Anchor(bennu, 10.0, 5.0))
    dpm.writer.put(*put_arguments(elevation(0.0), "dem", 1, resolution_m=0.1))
    uris = http.get("/ogc/collections/dem").json()["crs"]
    assert uris == ["http://127.0.0.1:8080/ogc/crs/bennu_lonlat"]
    assert "ELLIPSOID" in http.get("/ogc/crs/bennu_lonlat").text
    (item,) = http.get("/stac/collections/dem/items").json()["features"]
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
