# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""HTTP behind a proxy, for pages of other origins, and compressed."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import brotli
import pytest
import zstandard
from fastapi.testclient import TestClient

from cdff_common.errors import ConfigurationError
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.http.middleware.compression import coding_for, is_compressible
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings, parse_settings

InsertedId = Callable[[str], str]
ORIGIN = "https://maps.example"


def client(dpm: Dpm, tmp_path: Path, **settings: Any) -> TestClient:
    app = create_app(Context(dpm, Settings(tmp_path, **settings)))
    return TestClient(app, base_url="http://127.0.0.1:8080", raise_server_exceptions=False)


def links_of(data: Any) -> set[str]:
    """Return every address in nested data: texts that are a path or a URL of the server."""
    if isinstance(data, str):
        return {data} if data.startswith(("/", "http://127.0.0.1")) else set()
    values = data.values() if isinstance(data, dict) else data if isinstance(data, list) else ()
    return {link for value in values for link in links_of(value)}


@pytest.mark.parametrize("is_stripped", [True, False])
@pytest.mark.parametrize("by_header", [True, False])
def test_links_begin_with_the_path_of_a_proxy(
    dpm: Dpm, tmp_path: Path, inserted_id: InsertedId, is_stripped: bool, by_header: bool
) -> None:
    dem = inserted_id("dem")
    settings = {"behind_proxy": True} if by_header else {"root_path": "/dpm"}
    headers = {"X-Forwarded-Prefix": "/dpm"} if by_header else {}
    http = client(dpm, tmp_path, **settings)
    paths = ["/stac", "/stac/search?limit=1", f"/stac/collections/dem/items/{dem}", "/ogc", "/tiles"]
    paths += ["/ogc/collections/dem/items?limit=1", "/api/v1/products?limit=1", "/api/v1/maps"]
    for path in paths:
        answer = http.get(path if is_stripped else f"/dpm{path}", headers=headers)
        assert answer.status_code == 200, path
        links = links_of(answer.json())
        assert links
        for link in links:
            assert link.removeprefix("http://127.0.0.1:8080").startswith("/dpm/"), (path, link)
    problem = http.get("/stac/search?nonsense=1", headers=headers)
    assert problem.status_code == 400
    assert http.get("/openapi.json", headers=headers).json()["servers"] == [{"url": "/dpm"}]


def test_headers_of_a_proxy_are_ignored_without_one_and_checked_with_one(dpm: Dpm, tmp_path: Path) -> None:
    def root(http: TestClient, **headers: str) -> Any:
        answer = http.get("/stac", headers={k.replace("_", "-"): v for k, v in headers.items()})
        return answer.json()["links"][0]["href"] if answer.status_code == 200 else answer.status_code

    direct = client(dpm, tmp_path)
    assert root(direct, X_Forwarded_Prefix="/evil", X_Forwarded_Host="evil") == "http://127.0.0.1:8080/stac"
    behind = client(dpm, tmp_path, behind_proxy=True, hosts=("maps.example",))
    assert root(behind, X_Forwarded_Host="maps.example") == "http://maps.example/stac"
    assert root(behind, X_Forwarded_Host="evil.example") == 421
    for prefix in ("//evil.example", "/a/../b", "/<script>", "a", "/" + "x" * 300):
        assert root(behind, X_Forwarded_Prefix=prefix) == 400
    with pytest.raises(ConfigurationError, match="root-path"):
        parse_settings(["--root-path", "dpm"], {})


def test_pages_of_listed_origins_may_read_and_search_but_not_write(
    dpm: Dpm, tmp_path: Path, inserted_id: InsertedId
) -> None:
    http = client(dpm, tmp_path, cors_origins=(ORIGIN,))
    dem = inserted_id("dem")
    answer = http.get("/stac", headers={"Origin": ORIGIN})
    assert answer.headers["access-control-allow-origin"] == ORIGIN
    assert "Link" in answer.headers["access-control-expose-headers"]
    other = http.get("/stac", headers={"Origin": "https://other.example"})
    assert "access-control-allow-origin" not in other.headers
    cross_site = {"Origin": ORIGIN, "Sec-Fetch-Site": "cross-site"}
    preflight = {"Access-Control-Request-Method": "POST", "Access-Control-Request-Headers": "content-type"}
    assert http.options("/stac/search", headers=cross_site | preflight).status_code == 200
    assert http.post("/stac/search", json={}, headers=cross_site).status_code == 200
    assert http.delete(f"/api/v1/products/{dem}", headers=cross_site).status_code == 403
    assert client(dpm, tmp_path).post("/stac/search", json={}, headers=cross_site).status_code == 403
    for_all = client(dpm, tmp_path, cors_origins=("*",))
    assert for_all.get("/stac", headers={"Origin": ORIGIN}).headers["access-control-allow-origin"] == "*"


DECODERS: dict[str, Callable[[bytes], bytes]] = {
    "gzip": gzip.decompress,
    "br": brotli.decompress,
    "zstd": lambda data: zstandard.ZstdDecompressor().decompressobj().decompress(data),
}


@pytest.mark.parametrize("coding", DECODERS)
@pytest.mark.parametrize("path", ["/stac", "/", "/openapi.json", "/wmts", "/static/app.js"])
def test_text_is_compressed_with_the_coding_that_a_client_accepts(
    dpm: Dpm, tmp_path: Path, coding: str, path: str
) -> None:
    http = client(dpm, tmp_path)
    plain = http.get(path, headers={"Accept-Encoding": "identity"})
    with http.stream("GET", path, headers={"Accept-Encoding": coding}) as answer:
        data = b"".join(answer.iter_raw())
    assert answer.headers["content-encoding"] == coding
    assert "Accept-Encoding" in answer.headers["vary"]
    assert int(answer.headers["content-length"]) == len(data) < len(plain.content)
    assert DECODERS[coding](data) == plain.content
    assert answer.headers.get("etag") == plain.headers.get("etag")
    if "etag" in answer.headers:
        known = {"If-None-Match": answer.headers["etag"], "Accept-Encoding": coding}
        assert http.get(path, headers=known).status_code == 304


def test_rasters_ranges_and_revisions_are_never_compressed(http: TestClient, inserted_id: InsertedId) -> None:
    product = f"/api/v1/products/{inserted_id('dem')}"
    for path in (f"{product}/payload?format=tif", f"{product}/payload", product):
        answer = http.get(path, headers={"Accept-Encoding": "gzip"})
        assert "content-encoding" not in answer.headers
    post = http.post("/stac/search", json={}, headers={"Accept-Encoding": "gzip"})
    assert post.headers["content-encoding"] == "gzip"
    assert post.json()["features"]


@pytest.mark.parametrize(
    ("accepted", "coding"),
    [
        ("", None),
        ("identity", None),
        ("gzip", "gzip"),
        ("gzip, deflate, br, zstd", "zstd"),
        ("zstd;q=0.5, br;q=0.9, gzip", "gzip"),
        ("gzip;q=0", None),
        ("*", "zstd"),
        ("*;q=0.1, identity", None),
        ("br;q=2, gzip", "gzip"),
        ("GZIP", "gzip"),
        (",;;q=,gzip;level=9" + "," * 5000, None),
    ],
)
def test_the_preferred_coding_is_used(accepted: str, coding: str | None) -> None:
    assert coding_for(accepted) == coding


def test_only_text_is_compressible() -> None:
    assert is_compressible("application/geo+json")
    assert is_compressible("text/html; charset=utf-8")
    assert not is_compressible("text/event-stream")
    assert not is_compressible("image/tiff; application=geotiff")
    assert not is_compressible("application/octet-stream")


HOSTILE = ["", ",", "\xff\xfe", "*" * 5000, "a/b;q=" * 2000, "text/html;q=\x00", "0" * 4000, "é" * 100]


@pytest.mark.parametrize(
    "name", ["Accept", "Accept-Encoding", "Range", "If-Range", "If-None-Match", "Origin"]
)
def test_hostile_headers_are_answered(http: TestClient, inserted_id: InsertedId, name: str) -> None:
    dem = inserted_id("dem")
    values = [
        *HOSTILE,
        "bytes=" + ",".join(f"{i}-{i}" for i in range(2000)),
        "bytes=-0",
        "bytes=9999999999999999999-",
        "bytes=5-1",
        "lines=1-2",
    ]
    for path in ("/stac", "/ogc/collections/dem/items", f"/api/v1/products/{dem}/payload?format=tif"):
        for value in values:
            try:
                answer = http.get(path, headers={name: value.encode("utf-8", "surrogateescape")})
            except (ValueError, UnicodeError):  # the client refuses to send it
                continue
            assert answer.status_code in (200, 206, 304, 400, 403, 416), (path, value[:40])
            if answer.status_code >= 400:
                assert answer.headers["content-type"] == "application/problem+json"


def test_a_body_with_a_content_coding_is_not_decompressed(http: TestClient) -> None:
    bomb = gzip.compress(b" " * (64 << 20) + b"{}")
    headers = {"Content-Encoding": "gzip", "Content-Type": "application/json"}
    answer = http.post("/stac/search", content=bomb, headers=headers)
    assert answer.status_code in (400, 415, 422)
