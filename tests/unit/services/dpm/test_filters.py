# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""STAC and OGC API Features: filters in CQL2, order, selection of fields, search of collections."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
from fastapi.testclient import TestClient

from cdff_common.clock import ManualClock
from cdff_common.geodesy import Anchor, body
from cdff_common.interfaces.product import Quality, Status
from dpm_store import open_store
from dpm_store.search import search as store_search
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.http.cql2.text import parse_text
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

from .conftest import S, elevation, pose, put_arguments

MARS = body("mars")


@pytest.fixture(scope="module")
def dpm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dpm]:
    """A DPM that no test of this file changes."""
    with open_store(f"sqlite:///{tmp_path_factory.mktemp('filters')}", ManualClock(100 * S)) as store:
        yield Dpm(store, max_payload_bytes=1 << 20)


@pytest.fixture(scope="module")
def http(dpm: Dpm) -> Iterator[TestClient]:
    """A client of its HTTP interface."""
    app = create_app(Context(dpm, Settings(dpm.store.directory, max_body_bytes=8 << 20)))
    with TestClient(app, base_url="http://127.0.0.1:8080", raise_server_exceptions=False) as client:
        yield client


@pytest.fixture(scope="module")
def ids(dpm: Dpm) -> dict[str, str]:
    """DEMs of two robots with different cells at 0, 2, 4 and 6 m east of the site, and a pose."""
    dpm.store.anchors.anchor("site", Anchor(MARS, 10.0, 0.0))
    result = {}
    for i, (name, robot, cell_m) in enumerate(
        [("a", "mana", 0.1), ("b", "mana", 0.2), ("c", "minnie", 0.1), ("d", "minnie", 0.4)]
    ):
        quality = Quality(Status.DEGRADED if name == "d" else Status.OK, metrics={"rms_m": 0.1 * i})
        value = elevation(2.0 * i, cells=10, resolution_m=0.1)
        arguments = put_arguments(value, "dem", i + 1, robot, resolution_m=cell_m, quality=quality)
        result[name] = dpm.writer.put(*arguments)[1].id
    result["pose"] = dpm.writer.put(*put_arguments(pose(9, 50.0), "pose", 9, child="mana/base"))[1].id
    return result


def names_of(ids: dict[str, str], answer: Any) -> str:
    assert answer.status_code == 200, answer.text
    names = {identifier: name for name, identifier in ids.items()}
    return ",".join(names[feature["id"]] for feature in answer.json()["features"])


CASES = [
    ("platform = 'mana' AND collection = 'dem'", "b,a"),
    ("gsd > 0.15 AND gsd <= 0.4", "d,b"),
    ("0.15 < gsd", "d,b"),
    ("gsd BETWEEN 0.1 AND 0.2 AND NOT platform = 'mana'", "c"),
    ("cdff:status <> 'OK'", "d"),
    ("platform LIKE 'm_nn%'", "d,c"),
    ("platform LIKE 'M%'", ""),
    ("CASEI(platform) LIKE casei('MINN%')", "d,c"),
    ("CASEI(cdff:status) = CASEI('degraded')", "d"),
    ("platform IN ('minnie', 'other') OR collection = 'pose'", "pose,d,c"),
    ("cdff:child IS NOT NULL", "pose"),
    ("gsd IS NULL", "pose"),
    ("datetime >= TIMESTAMP('1970-01-01T00:00:03Z') AND datetime < TIMESTAMP('1970-01-01T00:00:05Z')", "d,c"),
    ("datetime > DATE('1970-01-01') AND collection = 'dem' AND datetime < '1970-01-01T00:00:02Z'", "a"),
    ('"cdff:metric:rms_m" > 0.15', "d,c"),
    ("start_datetime < end_datetime", ""),
    ("platform = 'it''s'", ""),
    ("TRUE", "pose,d,c,b,a"),
    ("FALSE", ""),
    ("S_INTERSECTS(geometry, BBOX(9.9, -1, 10.1, 1)) AND gsd = 0.1", "c,a"),
    ("S_INTERSECTS(geometry, POINT(10.00001 0.00001)) OR gsd = 0.4", "d,a"),
    ("NOT S_INTERSECTS(geometry, POINT(10.00001 0.00001)) AND collection = 'dem'", "d,c,b"),
]


@pytest.mark.parametrize(("text", "expected"), CASES)
def test_filters_as_text_and_as_json_find_the_same_items(
    http: TestClient, ids: dict[str, str], text: str, expected: str
) -> None:
    answer = http.get("/stac/search", params={"filter": text})
    assert names_of(ids, answer) == expected
    assert answer.json()["numberMatched"] == len([n for n in expected.split(",") if n])
    as_json = {"filter": parse_text(text), "filter-lang": "cql2-json"}
    assert names_of(ids, http.post("/stac/search", json=as_json)) == expected
    in_url = {"filter": json.dumps(parse_text(text)), "filter-lang": "cql2-json"}
    assert names_of(ids, http.get("/stac/search", params=in_url)) == expected


def test_a_filter_restricts_searches_in_a_box_of_a_collection_and_by_ids(
    http: TestClient, ids: dict[str, str]
) -> None:
    box = "9.9,-0.1,10.1,0.1"
    assert (
        names_of(ids, http.get("/stac/search", params={"bbox": box, "filter": "gsd = 0.1", "limit": 1}))
        == "c"
    )
    items = http.get("/stac/collections/dem/items", params={"filter": "platform = 'mana'"})
    assert names_of(ids, items) == "b,a"
    some = http.get("/stac/search", params={"ids": f"{ids['a']},{ids['d']},unknown", "filter": "gsd < 0.3"})
    assert names_of(ids, some) == "a"


@pytest.mark.parametrize(
    ("sortby", "expected"),
    [
        ("datetime", "a,b,c,d,pose"),
        ("-datetime", "pose,d,c,b,a"),
        ("platform,-gsd", "b,a,pose,d,c"),
        ("+gsd,platform", "pose,a,c,b,d"),
        ("-properties.gsd,id", None),
        ("collection,-start_datetime", "d,c,b,a,pose"),
    ],
)
def test_items_are_sorted_over_all_pages(
    http: TestClient, ids: dict[str, str], sortby: str, expected: str | None
) -> None:
    for place in ({}, {"bbox": "9,-1,11,1"}):
        names_of_pages: list[str] = []
        page = http.get("/stac/search", params={"sortby": sortby, "limit": 2, **place})
        while True:
            names_of_pages.append(names_of(ids, page))
            following = [link["href"] for link in page.json()["links"] if link["rel"] == "next"]
            if not following:
                break
            page = http.get(following[0])
        whole = http.get("/stac/search", params={"sortby": sortby, **place})
        assert ",".join(names_of_pages) == names_of(ids, whole)
        if expected is not None:
            assert ",".join(names_of_pages) == expected
    fields = [
        {"field": name.lstrip("+-"), "direction": "desc" if name[0] == "-" else "asc"}
        for name in sortby.split(",")
    ]
    posted = http.post("/stac/search", json={"sortby": fields, "limit": 3})
    assert names_of(ids, posted) == ",".join(names_of(ids, whole).split(",")[:3])


def test_fields_are_added_to_the_smallest_item_and_removed(http: TestClient, ids: dict[str, str]) -> None:
    def item(**selection: Any) -> Any:
        return http.get("/stac/search", params={"ids": ids["a"], **selection}).json()["features"][0]

    assert set(item(fields="")["properties"]) == {"datetime"}
    assert set(item(fields="platform,properties.gsd")["properties"]) == {"datetime", "platform", "gsd"}
    assert "geometry" not in item(fields="-geometry")
    assert "proj:wkt2" in item(fields="properties")["properties"]
    assert "proj:wkt2" not in item(fields="properties,-properties.proj:wkt2")["properties"]
    assert set(item(fields="-assets.tif")["assets"]) == set(item(fields="")["assets"]) - {"tif"}
    body = {"ids": [ids["a"]], "fields": {"include": ["platform"], "exclude": ["links"]}}
    (posted,) = http.post("/stac/search", json=body).json()["features"]
    assert "links" not in posted
    assert posted["properties"]["platform"] == "mana"


def test_items_of_lists_are_short_and_single_items_have_every_field(
    http: TestClient, ids: dict[str, str]
) -> None:
    answer = http.get("/stac/search", params={"collections": "dem"})
    assert len(answer.content) / 4 < 2000
    listed = answer.json()["features"][0]
    (href,) = [link["href"] for link in listed["links"] if link["rel"] == "self"]
    single = http.get(href).json()
    assert listed["properties"].items() <= single["properties"].items()
    assert set(listed["assets"]) < set(single["assets"])
    assert {"proj:wkt2", "proj:geometry", "cdff:config_hash"} <= set(single["properties"])


def test_queryables_are_a_schema_of_the_properties_of_filters(http: TestClient, ids: dict[str, str]) -> None:
    for path in ("/stac/queryables", "/stac/collections/dem/queryables"):
        answer = http.get(path)
        assert answer.headers["content-type"] == "application/schema+json"
        document = answer.json()
        assert document["$id"].endswith(path)
        assert document["additionalProperties"] is False
        for name, known in document["properties"].items():
            if known.get("type") == "number":
                assert http.get("/stac/search", params={"filter": f"{name} > 0"}).status_code == 200
    assert http.get("/stac/collections/nothing/queryables").status_code == 404


def test_collections_are_searched_and_summarised(http: TestClient, ids: dict[str, str]) -> None:
    def found(**parameters: Any) -> list[str]:
        answer = http.get("/stac/collections", params=parameters).json()
        assert answer["numberReturned"] == len(answer["collections"])
        return [collection["id"] for collection in answer["collections"]]

    assert found() == ["dem", "pose"]
    assert found(q="elevation") == ["dem"]
    assert found(bbox="10.0005,-1,11,1") == ["pose"]
    assert found(bbox="20,-1,21,1") == []
    assert found(datetime="../1970-01-01T00:00:05Z") == ["dem"]
    first = http.get("/stac/collections?limit=1").json()
    (following,) = [link["href"] for link in first["links"] if link["rel"] == "next"]
    assert [c["id"] for c in http.get(following).json()["collections"]] == ["pose"]
    dem = http.get("/stac/collections/dem").json()
    assert dem["summaries"]["platform"] == ["mana", "minnie"]
    assert dem["summaries"]["gsd"] == {"minimum": 0.1, "maximum": 0.4}
    assert dem["summaries"]["cdff:status"] == ["DEGRADED", "OK"]
    assert dem["item_assets"]["tif"]["type"].startswith("image/tiff")


BOMBS: list[Any] = [
    "(" * 9000 + "gsd=1" + ")" * 9000,
    "NOT " * 4000 + "gsd=1",
    "gsd=1" + " OR gsd=1" * 2000,
    "CASEI(" * 3000,
    "platform LIKE '" + "%a" * 400 + "'",
    "platform = '" + "x" * 19_000 + "'",
    "gsd IN (" + ",".join(["1"] * 5000) + ")",
    "gsd = " + "9" * 5000,
    "unknown = 1",
    "gsd = 'text'",
    "platform = 1",
    "platform BETWEEN 'a' AND 'b'",
    "datetime > TIMESTAMP('yesterday')",
    "gsd",
    "",
    "'",
    "\x00",
    "S_INTERSECTS(geometry, POLYGON((0 0, 1 1, 0 1, 1 0, 0 0)))",
    "S_INTERSECTS(geometry, POINT(1000 1000))",
    "S_INTERSECTS(platform, POINT(1 1))",
    "S_INTERSECTS(geometry, BBOX(1,2,3))",
    {"op": "and", "args": []},
    {"op": "and"},
    {"op": 1, "args": [1]},
    {"op": "=", "args": [{"property": "gsd"}, {"property": 1}]},
    {"op": "=", "args": [{"property": "gsd"}, None]},
    {"op": "=", "args": [{"property": "gsd"}, float("1e400")]},
    {"op": "in", "args": [{"property": "gsd"}, 1]},
    {"op": "like", "args": [{"property": "platform"}, 1]},
    {"op": "s_intersects", "args": [{"property": "geometry"}, {"type": "Nonsense", "coordinates": [1]}]},
    {"op": "s_intersects", "args": [{"property": "geometry"}, {"bbox": ["a", 1, 2, 3]}]},
    {"op": "casei", "args": [{"property": "platform"}]},
    {"op": "drop table", "args": []},
]


@pytest.mark.parametrize("bomb", BOMBS, ids=lambda bomb: str(bomb)[:30])
def test_malformed_and_excessive_filters_are_refused(
    http: TestClient, ids: dict[str, str], bomb: Any
) -> None:
    content = json.dumps({"filter": bomb})
    answer = http.post("/stac/search", content=content, headers={"Content-Type": "application/json"})
    is_harmless = isinstance(bomb, str) and bomb.startswith("((")
    assert answer.status_code == (200 if is_harmless else 400), answer.text
    if not is_harmless:
        assert answer.headers["content-type"] == "application/problem+json"
        assert answer.json()["detail"]


def test_deep_json_and_geometries_with_many_corners_are_refused(http: TestClient) -> None:
    deep: Any = {"op": "=", "args": [{"property": "gsd"}, 1]}
    for _ in range(30):
        deep = {"op": "not", "args": [deep]}
    assert http.post("/stac/search", json={"filter": deep}).status_code == 400
    headers = {"Content-Type": "application/json"}
    for nested in ('{"filter":' + '{"op":"not","args":[' * 50_000, '{"intersects":' + "[" * 100_000):
        assert http.post("/stac/search", content=nested, headers=headers).status_code in (400, 422)
    ring = [[i * 1e-3, (i % 2) * 1e-3] for i in range(100_000)]
    geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    for search in (
        {"intersects": geometry},
        {"filter": {"op": "s_intersects", "args": [{"property": "geometry"}, geometry]}},
    ):
        answer = http.post("/stac/search", json=search)
        assert (answer.status_code, "corners" in answer.json()["detail"]) == (400, True)


def test_a_filter_that_takes_too_long_is_ended(
    http: TestClient, ids: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store_search, "_LONGEST_S", -1.0)
    monkeypatch.setattr("dpm_store.engine.sqlite._STEPS", 1)
    answer = http.get("/stac/search", params={"filter": "platform LIKE '%m%'"})
    assert answer.status_code == 503
    assert answer.headers["retry-after"]
    assert http.get("/stac/search").status_code == 200


@pytest.mark.parametrize(
    "parameters",
    [
        {"sortby": "unknown"},
        {"sortby": "cdff:metric:rms_m"},
        {"sortby": "gsd", "token": "x"},
        {"sortby": "gsd", "token": "W1tdLCBbXV0"},
        {"filter": "gsd = 1", "filter-lang": "ecql"},
        {"filter": "gsd = 1", "filter-crs": "http://www.opengis.net/def/crs/EPSG/0/3857"},
        {"filter": "{", "filter-lang": "cql2-json"},
        {"fields": ",".join(f"x{i}" for i in range(1000))},
    ],
)
def test_odd_parameters_of_a_search_are_refused(http: TestClient, parameters: dict[str, str]) -> None:
    answer = http.get("/stac/search", params=parameters)
    assert answer.status_code == 400, answer.text
