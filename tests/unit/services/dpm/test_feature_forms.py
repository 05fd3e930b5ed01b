# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""OGC API Features: filter, order and properties; schemas; HTML, JSON-FG and GeoPackage; further bodies."""

from __future__ import annotations

import json
import re
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from cdff_common.clock import ManualClock
from cdff_common.geodesy import Anchor, body
from cdff_common.types import Pointcloud
from dpm_store import open_store
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

from .conftest import S, elevation, put_arguments

ITEMS = "/ogc/collections/dem/items"
CLOUDS = "/ogc/collections/pointcloud"


@pytest.fixture(scope="module")
def dpm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dpm]:
    """A DPM with three DEMs of two robots on Mars, and clouds on Mars, on the Moon and without a place."""
    with open_store(f"sqlite:///{tmp_path_factory.mktemp('forms')}", ManualClock(100 * S)) as store:
        dpm = Dpm(store, max_payload_bytes=1 << 20)
        store.anchors.anchor("site", Anchor(body("mars"), 77.0, 18.0))
        store.anchors.anchor("moon/camp", Anchor(body("moon"), 10.0, 0.0))
        for i, (robot, cell_m) in enumerate([("mana", 0.1), ("mana", 0.2), ("minnie", 0.4)]):
            value = elevation(2.0 * i, cells=10, resolution_m=0.1)
            dpm.writer.put(*put_arguments(value, "dem", i + 1, robot, resolution_m=cell_m))
        for i, frame in enumerate(("site", "moon/camp", "mana/odom")):
            cloud = Pointcloud.from_points(np.zeros((3, 3)), frame=frame, stamp_ns=S)
            box_m = (0.0, 0.0, 0.0, 10.0, 1.0, 0.0)
            dpm.writer.put(*put_arguments(cloud, "pointcloud", 10 + i, frame=frame, box_m=box_m))
        yield dpm


@pytest.fixture(scope="module")
def http(dpm: Dpm) -> Iterator[TestClient]:
    """A client of its HTTP interface."""
    app = create_app(Context(dpm, Settings(dpm.store.directory)))
    with TestClient(app, base_url="http://127.0.0.1:8080", raise_server_exceptions=False) as client:
        yield client


def cells(http: TestClient, **parameters: Any) -> list[float]:
    answer = http.get(ITEMS, params=parameters)
    assert answer.status_code == 200, answer.text
    return [feature["properties"]["resolution_m"] for feature in answer.json()["features"]]


def test_features_are_filtered_and_sorted_by_their_properties(http: TestClient) -> None:
    assert cells(http) == [0.4, 0.2, 0.1]
    assert cells(http, filter="robot = 'mana' AND resolution_m > 0.1") == [0.2]
    as_json = json.dumps({"op": "=", "args": [{"property": "robot"}, "minnie"]})
    assert cells(http, **{"filter": as_json, "filter-lang": "cql2-json"}) == [0.4]
    assert cells(http, filter="t1 < TIMESTAMP('1970-01-01T00:00:02Z')") == [0.1]
    assert cells(http, sortby="robot,-resolution_m") == [0.2, 0.1, 0.4]
    first = http.get(ITEMS, params={"sortby": "resolution_m", "limit": 2}).json()
    (following,) = [link["href"] for link in first["links"] if link["rel"] == "next"]
    rest = http.get(following).json()["features"]
    assert [f["properties"]["resolution_m"] for f in rest] == [0.4]
    for odd in ("filter=platform='mana'", "sortby=platform", "properties=platform", "f=kml"):
        assert http.get(f"{ITEMS}?{odd}").status_code == 400
    assert http.get("/ogc/collections/trajectories/items?filter=robot='a'").status_code in (400, 404)


def test_features_have_only_the_requested_properties_and_no_geometry(http: TestClient) -> None:
    (feature, *_) = http.get(f"{ITEMS}?properties=robot,t1&skipGeometry=true").json()["features"]
    assert set(feature["properties"]) == {"robot", "t1"}
    assert feature["geometry"] is None
    schema = http.get("/ogc/collections/dem/schema").json()
    whole = http.get(ITEMS).json()["features"][0]["properties"]
    assert set(whole) == set(schema["properties"]) - {"geometry"}
    queryables = http.get("/ogc/collections/dem/queryables").json()
    assert set(queryables["properties"]) - set(schema["properties"]) == {"id"}


@pytest.mark.parametrize(
    "path", ["/ogc", "/ogc/collections", ITEMS, "/stac", "/stac/search", "/stac/queryables"]
)
def test_browsers_get_pages_and_programs_get_json(http: TestClient, path: str) -> None:
    browser = {"Accept": "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"}
    page = http.get(path, headers=browser)
    assert page.headers["content-type"].startswith("text/html")
    assert "Accept" in page.headers["vary"]
    assert "<script" not in page.text
    assert http.get(f"{path}?f=html").text.startswith("<!doctype html>")
    for accepted in ("application/json", "application/geo+json, text/html", "*/*"):
        assert "json" in http.get(path, headers={"Accept": accepted}).headers["content-type"]
    assert "json" in http.get(f"{path}?f=json", headers=browser).headers["content-type"]
    for href in re.findall(r'href="(http://127[^"]+)"', page.text)[:10]:
        assert http.get(href.replace("&amp;", "&"), headers=browser).status_code == 200
    refused = http.get(f"{path}?nonsense=<script>alert(1)</script>", headers=browser)
    assert refused.headers["content-type"] == "application/problem+json"


def test_text_of_products_is_no_markup_in_a_page(http: TestClient, dpm: Dpm) -> None:
    arguments = put_arguments(elevation(0.0), "dem", 50, resolution_m=0.1)
    names, payload, encoding, attachment = arguments
    import msgpack

    header = msgpack.unpackb(attachment)
    header["producer"] = "<img src=x onerror=alert(1)>"
    identifier = dpm.writer.put(names, payload, encoding, msgpack.packb(header))[1].id
    page = http.get(f"{ITEMS}/{identifier}?f=html").text
    assert "&lt;img src=x" in page
    assert "<img src=x" not in page
    dpm.writer.delete(identifier)


_READ = """
import json, sys
from pyogrio.raw import read
import shapely
meta, _, geometry, data = read(sys.argv[1])
names = list(meta["fields"])
print(json.dumps({"crs": meta["crs"], "fields": names, "count": len(geometry),
  "ids": [str(v) for v in data[names.index("id")]] if "id" in names else [],
  "bounds": [None if g is None else list(shapely.from_wkb(g).bounds) for g in geometry]}))
"""


def read_by_gdal(path: Path) -> Any:
    """Return what the GDAL of pyogrio reads, in a separate process because rasterio contains another GDAL."""
    pytest.importorskip("pyogrio", reason="pyogrio is not installed")
    command = [sys.executable, "-c", _READ, str(path)]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert answer.returncode == 0, answer.stderr
    return json.loads(answer.stdout)


def test_gdal_reads_a_search_exported_as_geopackage(http: TestClient, tmp_path: Path) -> None:
    features = http.get(f"{ITEMS}?filter=robot='mana'").json()["features"]
    answer = http.get(f"{ITEMS}?filter=robot='mana'&f=gpkg&limit=1")
    assert answer.headers["content-type"] == "application/geopackage+sqlite3"
    path = tmp_path / "dem.gpkg"
    path.write_bytes(answer.content)
    read = read_by_gdal(path)
    assert "Mars" in read["crs"] or "49900" in read["crs"]
    assert sorted(read["ids"]) == sorted(f["id"] for f in features)
    expected = np.array([f["geometry"]["coordinates"][0] for f in features])
    assert np.allclose(np.array(read["bounds"])[:, :2].min(axis=0), expected.min(axis=(0, 1)), atol=1e-12)
    with closing(sqlite3.connect(path)) as database:
        (cell_m,) = database.execute("SELECT max(resolution_m) FROM dem").fetchone()
        assert (cell_m, database.execute("PRAGMA integrity_check").fetchone()) == (0.2, ("ok",))


def test_gdal_reads_features_as_json_fg_with_places_in_their_crs(http: TestClient, tmp_path: Path) -> None:
    answer = http.get(f"{CLOUDS}/items?f=jsonfg")
    assert answer.headers["content-type"] == "application/vnd.ogc.fg+json"
    document = answer.json()
    assert document["coordRefSys"].endswith("/ogc/crs/mars_lonlat")
    lost, moon, site = document["features"]
    assert all(f["geometry"] is None and f["time"]["interval"] for f in (lost, moon, site))
    assert "coordRefSys" not in site
    assert lost["coordRefSys"] == "http://127.0.0.1:8080/ogc/crs/frame/mana/odom"
    assert lost["place"]["coordinates"][0][2] == [10.0, 1.0]
    wkt = http.get(lost["coordRefSys"]).text
    assert "mana/odom" in wkt
    assert http.get("/ogc/crs/frame/nothing").status_code == 404
    items = http.get(f"{ITEMS}?f=jsonfg&crs=http://www.opengis.net/def/crs/IAU/2015/49910")
    path = tmp_path / "dem.fg.json"
    path.write_bytes(items.content)
    read = read_by_gdal(path)
    assert read["count"] == 3
    assert "Mars" in read["crs"] or "49910" in read["crs"]
    assert all(b is not None and 4e6 < b[0] < 5e6 for b in read["bounds"])


def test_each_body_has_a_collection_with_its_own_crs(http: TestClient) -> None:
    collections = {c["id"]: c for c in http.get("/ogc/collections").json()["collections"]}
    assert {"pointcloud", "pointcloud-moon"} <= set(collections)
    assert "dem-moon" not in collections
    moon = collections["pointcloud-moon"]
    assert moon == http.get(f"{CLOUDS}-moon").json()
    assert moon["storageCrs"] == "http://www.opengis.net/def/crs/IAU/2015/30100"
    west, south, _, _ = moon["extent"]["spatial"]["bbox"][0]
    assert (west, south) == pytest.approx((10.0, 0.0), abs=1e-9)
    page = http.get(f"{CLOUDS}-moon/items").json()
    (feature,) = page["features"]
    assert page["numberMatched"] == 1
    assert feature["geometry"]["coordinates"][0][0] == pytest.approx([10.0, 0.0])
    (self_link,) = [link["href"] for link in feature["links"] if link["rel"] == "self"]
    assert http.get(self_link).json()["geometry"] == feature["geometry"]
    assert http.get(f"{CLOUDS}-moon/items?bbox=9,-1,11,1").json()["numberMatched"] == 1
    assert http.get(f"{CLOUDS}-moon/items?bbox=76,17,78,19").json()["numberMatched"] == 0
    for path in (f"{CLOUDS}-earth", f"{CLOUDS}-mars/items", "/ogc/collections/dem-moon"):
        assert http.get(path).status_code == 404
    assert len(http.get(f"{CLOUDS}/items").json()["features"]) == 3
