# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Searches as GeoParquet, read by GeoPandas and by stac-geoparquet."""

from __future__ import annotations

import io
import json
import subprocess
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from fastapi.testclient import TestClient

from cdff_common.clock import ManualClock
from cdff_common.geodesy import Anchor, Body, body
from cdff_common.types import Pointcloud
from dpm_store import open_store
from services.dpm.http import geoparquet
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

from .conftest import S, elevation, put_arguments

ITEMS = "/ogc/collections/dem/items"
MEDIA_TYPE = "application/vnd.apache.parquet"
#: Interpreter of the environment of `make peers` that has stac-geoparquet.
PEER = Path(__file__).parents[4] / "build/dpm-peers/bin/python"


@pytest.fixture(scope="module")
def dpm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dpm]:
    """A DPM with three DEMs and a cloud on Mars, a cloud on the Moon and a cloud without a place."""
    with open_store(f"sqlite:///{tmp_path_factory.mktemp('parquet')}", ManualClock(100 * S)) as store:
        dpm = Dpm(store, max_payload_bytes=1 << 20)
        store.anchors.anchor("site", Anchor(body("mars"), 77.0, 18.0))
        store.anchors.anchor("moon/camp", Anchor(body("moon"), 10.0, 0.0))
        for i, robot in enumerate(("mana", "mana", "minnie")):
            value = elevation(2.0 * i, cells=10, resolution_m=0.1)
            dpm.writer.put(*put_arguments(value, "dem", i + 1, robot, resolution_m=0.1 * (i + 1)))
        for i, frame in enumerate(("site", "moon/camp", "mana/odom")):
            value = Pointcloud.from_points(np.zeros((3, 3)), frame=frame, stamp_ns=S)
            box_m = (0.0, 0.0, 0.0, 10.0, 1.0, 0.0)
            dpm.writer.put(*put_arguments(value, "pointcloud", 10 + i, frame=frame, box_m=box_m))
        yield dpm


@pytest.fixture(scope="module")
def http(dpm: Dpm) -> Iterator[TestClient]:
    """A client of its HTTP interface."""
    app = create_app(Context(dpm, Settings(dpm.store.directory)))
    with TestClient(app, base_url="http://127.0.0.1:8080", raise_server_exceptions=False) as client:
        yield client


@pytest.fixture(scope="module")
def geopandas() -> Any:
    """GeoPandas with the library that reads Parquet."""
    pytest.importorskip("pyarrow", reason="pyarrow is not installed; make peers installs it")
    return pytest.importorskip("geopandas", reason="geopandas is not installed")


def test_geopandas_reads_the_features_of_all_pages_on_their_body(http: TestClient, geopandas: Any) -> None:
    features = {f["id"]: f for f in http.get(ITEMS).json()["features"]}
    answer = http.get(f"{ITEMS}?f=parquet&limit=1")
    assert answer.headers["content-type"] == MEDIA_TYPE
    assert answer.headers["content-disposition"] == 'attachment; filename="dem.parquet"'
    frame = geopandas.read_parquet(io.BytesIO(answer.content)).set_index("id")
    assert frame.crs.to_authority() == ("IAU_2015", "49900")
    assert set(frame.index) == set(features)
    for identifier, row in frame.iterrows():
        expected = features[identifier]
        assert row.geometry.equals_exact(shapely.geometry.shape(expected["geometry"]), 1e-12)
        for name in ("robot", "frame", "status", "resolution_m", "size_bytes", "payload", "outline_m"):
            assert row[name] == expected["properties"][name]
        assert row.t1 == datetime.fromisoformat(expected["properties"]["t1"])


def test_geopandas_reads_the_features_of_a_box_by_their_bounds(
    http: TestClient, geopandas: Any, tmp_path: Path
) -> None:
    path = tmp_path / "dem.parquet"
    path.write_bytes(http.get(f"{ITEMS}?f=parquet").content)
    west = geopandas.read_parquet(path)
    bounds = west.geometry[west.geometry.bounds.minx.idxmin()].bounds
    (row,) = geopandas.read_parquet(
        path, bbox=(bounds[0] - 1e-6, bounds[1], bounds[0], bounds[3])
    ).itertuples()
    assert row.geometry.bounds == bounds


def test_a_filter_selects_the_exported_features(http: TestClient, geopandas: Any) -> None:
    content = http.get(f"{ITEMS}?f=parquet&filter=robot='minnie'").content
    assert list(geopandas.read_parquet(io.BytesIO(content)).robot) == ["minnie"]
    empty = geopandas.read_parquet(io.BytesIO(http.get(f"{ITEMS}?f=parquet&filter=robot='none'").content))
    assert empty.empty
    assert empty.crs.to_authority() == ("IAU_2015", "49900")


def test_features_without_a_place_on_the_body_have_no_geometry(http: TestClient, geopandas: Any) -> None:
    content = http.get("/ogc/collections/pointcloud/items?f=parquet").content
    frame = geopandas.read_parquet(io.BytesIO(content))
    assert dict(zip(frame.frame, frame.geometry.isna(), strict=True)) == {
        "site": False,
        "moon/camp": True,
        "mana/odom": True,
    }
    assert frame.outline_m.notna().all()
    moon = http.get("/ogc/collections/pointcloud-moon/items?f=parquet").content
    assert geopandas.read_parquet(io.BytesIO(moon)).crs.to_authority() == ("IAU_2015", "30100")


def test_geopandas_reads_the_items_of_a_search(http: TestClient, geopandas: Any) -> None:
    answer = http.get("/stac/search?collections=dem&f=parquet&limit=2")
    assert answer.headers["content-type"] == MEDIA_TYPE
    frame = geopandas.read_parquet(io.BytesIO(answer.content))
    assert frame.crs.to_authority() == ("IAU_2015", "49900")
    items = {i["id"]: i for i in http.get("/stac/search?collections=dem").json()["features"]}
    assert {row.id: row.platform for row in frame.itertuples()} == {
        i: item["properties"]["platform"] for i, item in items.items()
    }
    assert (frame.datetime.max() - frame.datetime.min()).total_seconds() == 2.0
    for row in frame.itertuples():
        assert row.assets["payload"]["href"] == items[row.id]["assets"]["payload"]["href"]


_READ_ITEMS = """
import json, sys
import pyarrow.parquet
import stac_geoparquet.arrow
table = pyarrow.parquet.read_table(sys.argv[1])
metadata = json.loads(table.schema.metadata[b"stac-geoparquet"])
items = list(stac_geoparquet.arrow.stac_table_to_items(table))
print(json.dumps({"items": items, "collections": list(metadata["collections"])}))
"""


@pytest.mark.slow
def test_stac_geoparquet_returns_the_same_items(http: TestClient, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed; make peers installs it")
    if not PEER.exists():
        pytest.skip("stac-geoparquet is not installed; make peers installs it")
    path = tmp_path / "items.parquet"
    path.write_bytes(http.get("/stac/collections/dem/items?f=parquet").content)
    command = [str(PEER), "-c", _READ_ITEMS, str(path)]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert answer.returncode == 0, answer.stderr
    read = json.loads(answer.stdout)
    assert read["collections"] == ["dem"]
    expected = {i["id"]: i for i in http.get("/stac/collections/dem/items").json()["features"]}
    assert {i["id"] for i in read["items"]} == set(expected)
    for item in read["items"]:
        original = expected[item["id"]]
        assert item["bbox"] == original["bbox"]
        assert shapely.geometry.shape(item["geometry"]).equals(shapely.geometry.shape(original["geometry"]))
        assert item["links"] == original["links"]
        assert item["assets"] == original["assets"]
        assert {n: _moment(v) for n, v in item["properties"].items()} == {
            n: _moment(v) for n, v in original["properties"].items()
        }


def _moment(value: Any) -> Any:
    """Return the time of an RFC 3339 text, another value as it is."""
    try:
        return datetime.fromisoformat(value)
    except (TypeError, ValueError):
        return value


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("/stac/search?f=parquet", "mars, moon"),
        ("/stac/search?collections=dem&f=parquet&fields=properties.gsd", "expected no fields"),
        ("/stac/search?f=arrow", "parquet"),
        ("/stac/queryables?f=shp", "parquet"),
    ],
)
def test_an_impossible_export_is_refused_with_the_reason(
    http: TestClient, geopandas: Any, path: str, reason: str
) -> None:
    answer = http.get(path)
    assert answer.status_code == 400
    assert reason in answer.json()["detail"]


@pytest.mark.parametrize("path", [f"{ITEMS}?f=parquet", "/stac/search?collections=dem&f=parquet"])
def test_more_features_than_a_file_may_have_are_refused(
    http: TestClient, geopandas: Any, monkeypatch: pytest.MonkeyPatch, path: str
) -> None:
    monkeypatch.setattr("services.dpm.http.routes.ogc.MOST_EXPORTED", 2)
    monkeypatch.setattr("services.dpm.http.routes.stac.MOST_EXPORTED", 2)
    answer = http.get(path)
    assert answer.status_code == 400
    assert "more than 2" in answer.json()["detail"]


def test_a_server_without_the_library_names_the_extra(
    http: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def absent(module: str) -> Any:
        raise ModuleNotFoundError(f"No module named {module!r}", name=module)

    monkeypatch.setattr("cdff_common.extras.importlib.import_module", absent)
    for path in (f"{ITEMS}?f=parquet", "/stac/search?f=parquet"):
        answer = http.get(path)
        assert answer.status_code == 400
        assert "pip install 'cdff[parquet]'" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("on", "crs"), [(body("earth"), ("OGC", "CRS84")), (body("mars"), ("IAU_2015", "49900")), (None, None)]
)
def test_the_crs_is_that_of_the_body(geopandas: Any, on: Body | None, crs: tuple[str, str] | None) -> None:
    shape = None if on is None else shapely.box(1.0, 2.0, 3.0, 4.0)
    data = geoparquet.write_features(
        on, [("a", shape, {"robot": "mana", "t0": None})], {"robot": "string", "t0": "string"}
    )
    frame = geopandas.read_parquet(io.BytesIO(data))
    assert (None if frame.crs is None else frame.crs.to_authority()) == crs
    assert list(frame.robot) == ["mana"]
    assert frame.t0.isna().all()
