# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Hostile filters, polygons, headers and ranges: problem documents, with bounded memory."""

from __future__ import annotations

import json
import math
import tracemalloc
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from cdff_common.clock import ManualClock
from dpm_store import open_store
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

from .conftest import S, TestClient, elevation, put_arguments

InsertedId = Callable[[str], str]
#: Memory that refusing a request may use, bytes; the largest body here has 5 MB.
_MOST_BYTES = 100 << 20


@pytest.fixture(scope="module")
def dpm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dpm]:
    """A DPM for all tests of this module, which change nothing."""
    with open_store(f"sqlite:///{tmp_path_factory.mktemp('store')}", ManualClock(100 * S)) as store:
        yield Dpm(store, max_payload_bytes=1 << 20)


@pytest.fixture(scope="module")
def http(dpm: Dpm) -> Iterator[TestClient]:
    """A client of its HTTP interface."""
    app = create_app(Context(dpm, Settings(dpm.store.directory, max_body_bytes=8 << 20)))
    with TestClient(app, base_url="http://127.0.0.1:8080", raise_server_exceptions=False) as client:
        yield client


@pytest.fixture(scope="module")
def inserted_id(dpm: Dpm) -> InsertedId:
    """Insert a DEM; return a function from its type to the id."""
    _, header = dpm.writer.put(*put_arguments(elevation(0.0), "dem", 0, resolution_m=0.1))
    return {"dem": header.id}.__getitem__


def star(corners: int) -> list[list[float]]:
    """Return a closed ring in degrees with many spikes."""
    ring = []
    for i in range(corners):
        angle, radius = 2.0 * math.pi * i / corners, 1.0 if i % 2 else 0.2
        ring.append([77.0 + radius * math.cos(angle), 18.0 + radius * math.sin(angle)])
    return [*ring, ring[0]]


BODIES: dict[str, dict[str, Any]] = {
    "polygon of 100 000 corners": {"intersects": {"type": "Polygon", "coordinates": [star(100_000)]}},
    "1 000 polygons of 100 corners": {
        "intersects": {"type": "MultiPolygon", "coordinates": [[star(100)]] * 1000}
    },
    "filter with a polygon of 100 000 corners": {
        "filter": {
            "op": "s_intersects",
            "args": [{"property": "geometry"}, {"type": "Polygon", "coordinates": [star(100_000)]}],
        }
    },
    "disjunction of 100 000": {
        "filter": {"op": "or", "args": [{"op": "=", "args": [{"property": "gsd"}, 1]}] * 100_000}
    },
    "list of 100 000": {"filter": {"op": "in", "args": [{"property": "platform"}, ["a"] * 100_000]}},
    "pattern of 100 000": {"filter": {"op": "like", "args": [{"property": "platform"}, "%a" * 50_000]}},
    "100 000 ids": {"ids": ["x"] * 100_000},
    "100 000 fields": {"fields": {"include": ["x"] * 100_000}},
    "100 000 sort keys": {"sortby": [{"field": "gsd", "direction": "asc"}] * 100_000},
}


def refusal(answer: Any) -> str:
    """Return the detail of a problem document of the caller's fault."""
    assert 400 <= answer.status_code < 500, answer.text[:200]
    assert answer.headers["content-type"] == "application/problem+json"
    return str(answer.json()["detail"])


@pytest.mark.parametrize("name", BODIES)
def test_a_hostile_search_is_refused_with_bounded_memory(
    http: TestClient, inserted_id: InsertedId, name: str
) -> None:
    body = json.dumps({"filter-lang": "cql2-json", **BODIES[name]})
    tracemalloc.start()
    try:
        answer = http.post("/stac/search", content=body, headers={"Content-Type": "application/json"})
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(refusal(answer)) < 1000
    assert peak < _MOST_BYTES


@pytest.mark.parametrize("depth", [200, 20_000])
def test_a_filter_of_nested_negations_is_refused(
    http: TestClient, inserted_id: InsertedId, depth: int
) -> None:
    inner = '{"op":"isNull","args":[{"property":"platform"}]}'
    body = '{"filter":' + '{"op":"not","args":[' * depth + inner + "]}" * depth + "}"
    refusal(http.post("/stac/search", content=body, headers={"Content-Type": "application/json"}))


@pytest.mark.parametrize(
    "text",
    [
        "(" * 10_200 + "gsd=1" + ")" * 10_200,
        "NOT " * 5_300 + "gsd=1",
        " OR ".join(["gsd=1"] * 2_500),
        "gsd=" + "1+" * 10_300 + "1",
        "platform LIKE '" + "%_" * 10_300 + "'",
        "platform='" + "'" * 20_001,
        "S_INTERSECTS(geometry,POLYGON((" + "1 1," * 10_000 + "1 1)))",
        "\x00" * 1000,
        "datetime > TIMESTAMP('" + "9" * 30_000 + "')",
        "gsd > 1e" + "9" * 10_000,
    ],
    ids=lambda text: text[:12].strip("\x00") or "zeros",
)
def test_a_hostile_filter_text_is_refused(http: TestClient, inserted_id: InsertedId, text: str) -> None:
    for path in ("/stac/search", "/ogc/collections/dem/items"):
        assert refusal(http.get(path, params={"filter": text, "filter-lang": "cql2-text"}))


@pytest.mark.parametrize(
    "accept",
    [
        "text/html;q=" + "9" * 5000,
        ",".join(["application/json"] * 3000),
        "a/" * 5000,
        ";" * 5000,
        "*/*;q=nan, text/html;q=-1",
        "text/html;q=1e999",
        "\xff\xfe/json",
    ],
    ids=["long q", "many types", "slashes", "semicolons", "nan", "overflow", "bytes"],
)
def test_a_hostile_accept_header_gets_an_answer(
    http: TestClient, inserted_id: InsertedId, accept: str
) -> None:
    for path in ("/stac", "/ogc/collections", "/ogc/collections/dem/items", "/api/v1/products"):
        answer = http.get(path, headers={"Accept": accept.encode("latin-1")})
        assert answer.status_code < 500, answer.text[:200]
        assert answer.content


@pytest.mark.parametrize(
    "value",
    [
        "bytes=" + ",".join(f"{i}-{i}" for i in range(2000)),
        "bytes=" + "9" * 5000 + "-",
        "bytes=-" + "9" * 5000,
        "bytes=5-1",
        "bytes=--1",
        "bytes=\u0661-",
        "items=0-1",
        "bytes=0-0,-1" * 100,
    ],
    ids=["many", "far", "long suffix", "reversed", "signs", "digits", "unit", "repeated"],
)
@pytest.mark.parametrize("form", ["", "?format=tif"])
def test_a_hostile_range_gets_the_file_or_a_refusal(
    http: TestClient, inserted_id: InsertedId, value: str, form: str
) -> None:
    url = f"/api/v1/products/{inserted_id('dem')}/payload{form}"
    whole = http.get(url).content
    answer = http.get(url, headers={"Range": value.encode()})
    assert answer.status_code in (200, 206, 400, 416, 422)
    if answer.status_code < 400:
        assert answer.content in whole
    else:
        assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("If-None-Match", ",".join(f'"{i}"' for i in range(5000))),
        ("If-None-Match", '"' * 5000),
        ("If-Range", "x" * 5000),
        ("Accept-Encoding", ",".join(["gzip;q=0.1", "br", "zstd"] * 1000)),
        ("Accept-Encoding", "gzip;q=" + "9" * 5000),
        ("X-Forwarded-Prefix", "/" + "../" * 1000),
        ("Origin", "null" * 1000),
        ("Content-Length", "5"),
    ],
)
def test_other_hostile_headers_get_an_answer(
    http: TestClient, inserted_id: InsertedId, name: str, value: str
) -> None:
    for path in ("/stac/search?limit=1", f"/api/v1/products/{inserted_id('dem')}/payload"):
        assert http.get(path, headers={name: value}).status_code < 500
