# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Query parameters of every route: repeated and unknown ones are refused, ``f=json`` is accepted."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import pytest
from fastapi.testclient import TestClient

InsertedId = Callable[[str], str]


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/api/v1/products?type=dem&type=pose", 422),
        ("/api/v1/products?limit=1&limit=2", 422),
        ("/api/v1/poses?robot=mana&robot=mana", 422),
        ("/api/v1/maps/dem/window?t1=1&t1=2", 422),
        ("/api/v1/history?since=0&since=1", 422),
        ("/tiles?frame=site&frame=site", 422),
        ("/stac/search?limit=1&limit=2", 400),
        ("/stac/search?collections=dem&collections=pose", 400),
        ("/ogc/collections/dem/items?bbox=1,2,3,4&bbox=1,2,3,5", 400),
        ("/ogc?f=json&f=json", 400),
    ],
)
def test_a_repeated_parameter_is_refused(
    http: TestClient, inserted_id: InsertedId, path: str, status: int
) -> None:
    answer = http.get(path)
    assert (answer.status_code, answer.json()["code"]) == (status, "INVALID_ARGUMENT")
    assert "repeated" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/api/v1/products?typ=dem", 422),
        ("/api/v1/frames?asof=1", 422),
        ("/api/v1/status?x=1", 422),
        ("/stac?x=1", 400),
        ("/stac/search?colections=dem", 400),
        ("/ogc/collections?x=1", 400),
        ("/ogc/collections/dem/items?nonsense=1", 400),
    ],
)
def test_an_unknown_parameter_is_refused(
    http: TestClient, inserted_id: InsertedId, path: str, status: int
) -> None:
    answer = http.get(path)
    assert (answer.status_code, answer.json()["code"]) == (status, "INVALID_ARGUMENT")


def test_a_deletion_with_an_unknown_parameter_deletes_nothing(
    http: TestClient, inserted_id: InsertedId
) -> None:
    url = f"/api/v1/products/{inserted_id('dem')}"
    assert http.delete(f"{url}?a=1&a=1").status_code == 422
    assert http.delete(f"{url}?dry_run=true").status_code == 422
    assert http.get(url).status_code == 200


@pytest.mark.parametrize(
    "path", ["", "/conformance", "/collections", "/collections/dem", "/collections/dem/items"]
)
@pytest.mark.parametrize("interface", ["/ogc", "/stac"])
def test_json_is_the_default_form_and_unknown_forms_are_refused(
    http: TestClient, inserted_id: InsertedId, interface: str, path: str
) -> None:
    default, with_format = http.get(f"{interface}{path}"), http.get(f"{interface}{path}?f=json")
    assert (default.status_code, with_format.status_code) == (200, 200)
    assert with_format.json().keys() == default.json().keys()
    page = http.get(f"{interface}{path}?f=html")
    assert (page.status_code, page.headers["content-type"]) == (200, "text/html; charset=utf-8")
    refused = http.get(f"{interface}{path}?f=kml")
    assert refused.status_code == 400
    assert "json" in refused.json()["detail"]


def test_the_first_requests_may_be_concurrent() -> None:
    script = """
from concurrent.futures import ThreadPoolExecutor
from services.dpm.http.app import _app_with_routes
app = _app_with_routes()
with ThreadPoolExecutor(4) as threads:
    documents = list(threads.map(lambda _: app.openapi(), range(4)))
assert all("Problem" in document["components"]["schemas"] for document in documents)
"""
    # In a process of its own, because FastAPI caches the document for the whole process.
    subprocess.run([sys.executable, "-c", script], check=True)
