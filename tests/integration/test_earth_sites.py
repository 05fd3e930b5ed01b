# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sites on the Earth, as pystac-client and GDAL read them: distances on WGS 84, and the antimeridian."""

from __future__ import annotations

import json
import shutil
import subprocess
import urllib.request
from collections.abc import Iterator

import numpy as np
import pyproj
import pytest

from cdff_common.codecs import encode, encoding_string
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap
from cdff_dev.ports import free_port

from .conftest import process_starter, wait_until

pytestmark = pytest.mark.integration

KILOMETRE_M, LIMIT_M = 1000.0, 0.1
LON_DEG = 1.48
WGS_84 = pyproj.Geod(ellps="WGS84")
S = 1_000_000_000


def call(url: str, method: str = "GET", body: bytes | None = None, **headers: str) -> bytes:
    """Return the body of the answer; raises HTTPError."""
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    request = urllib.request.Request(url, body, named, method=method)
    with urllib.request.urlopen(request, timeout=60) as answer:
        return bytes(answer.read())


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """An empty DPM."""
    folder = tmp_path_factory.mktemp("earth")
    port, endpoint = free_port(), f"tcp/127.0.0.1:{free_port()}"
    address = f"http://127.0.0.1:{port}"

    def is_ready() -> bool:
        try:
            call(f"{address}/readyz")
        except OSError:
            return False
        return True

    with process_starter(endpoint, folder) as start:
        start("services.router")
        start("services.dpm", "--http", f"127.0.0.1:{port}", "--data-dir", str(folder / "data"))
        wait_until(is_ready, 180, "the DPM")
        yield address


def put_patch(url: str, frame: str, x_m: float, y_m: float) -> str:
    """Insert a map of 2 m x 2 m with its lower left corner at (x, y); return its id."""
    grid = GridGeometry(frame, 0.1, x_m, y_m + 2.0, 20, 20)
    one = np.ones(grid.shape, dtype=np.float32)
    layers = dict.fromkeys(("mean", "variance", "min", "max", "count", "age_s"), one)
    value = ElevationMap.from_layers(grid, layers, t0_ns=S, t1_ns=S)
    identifier = product_id("mana", "mapping", f"dem_{x_m}_{y_m}_{frame}", S, 1, "c")
    box_m = (x_m, y_m, 1.0, x_m + 2.0, y_m + 2.0, 1.0)
    header = Header(
        identifier, 1, S, S, frame, "mapping/one/1", config_hash="c", box_m=box_m, resolution_m=0.1
    )
    fields = header.to_dict() | {"t0_ns": str(S), "t1_ns": str(S)}
    call(
        f"{url}/api/v1/products?robot=mana&dfpc=mapping&port=dem&product=dem",
        "POST",
        encode(value, "uper"),
        Content_Type=encoding_string("ElevationMap", "uper"),
        CDFF_Header=json.dumps(fields),
    )
    return identifier


def anchor(url: str, frame: str, lon_deg: float, lat_deg: float) -> None:
    """Anchor a frame on the Earth."""
    body = {"body": "earth", "lon_deg": lon_deg, "lat_deg": lat_deg}
    call(f"{url}/api/v1/places/{frame}", "PUT", json.dumps(body).encode(), Content_Type="application/json")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gdaltransform") is None, reason="GDAL is not installed; run `make peers`")
@pytest.mark.parametrize("lat_deg", [0.0, 43.56, -67.5, 85.0])
def test_a_kilometre_of_a_site_on_the_earth_is_a_kilometre_for_stac_and_gdal(
    url: str, lat_deg: float
) -> None:
    frame = f"site_{lat_deg:g}".replace("-", "south_").replace(".", "_")
    anchor(url, frame, LON_DEG, lat_deg)
    for x_m, y_m in ((KILOMETRE_M, 0.0), (0.0, KILOMETRE_M)):
        identifier = put_patch(url, frame, x_m, y_m)
        item = json.loads(call(f"{url}/stac/collections/dem/items/{identifier}"))
        corners = np.array(item["geometry"]["coordinates"][0])[:, :2]
        distances_m = [WGS_84.inv(LON_DEG, lat_deg, lon, lat)[2] for lon, lat in corners]
        assert min(distances_m) == pytest.approx(KILOMETRE_M, abs=LIMIT_M)
        file = f"/vsicurl/{item['assets']['tif']['href']}"
        command = ["gdaltransform", "-t_srs", "OGC:CRS84", "-output_xy", file]
        # The lower left corner, in pixels of the file.
        answer = subprocess.run(
            command, input="0 20\n", capture_output=True, text=True, timeout=60, check=True
        )
        lon, lat = (float(number) for number in answer.stdout.split())
        gdal_m = WGS_84.inv(LON_DEG, lat_deg, lon, lat)[2]
        print(f"latitude {lat_deg} deg: STAC {min(distances_m):.3f} m, GDAL {gdal_m:.3f} m")
        assert gdal_m == pytest.approx(KILOMETRE_M, abs=LIMIT_M)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ogrinfo") is None, reason="GDAL is not installed; run `make peers`")
def test_a_site_on_the_antimeridian_is_found_by_pystac_client_and_gdal(url: str) -> None:
    pystac_client = pytest.importorskip("pystac_client", reason="pystac-client is not installed")
    anchor(url, "taveuni", 180.0, -16.8)
    west, crossing, east = (put_patch(url, "taveuni", x_m, 0.0) for x_m in (-100.0, -1.0, 100.0))
    boxes = {
        (179.99, -17.0, -179.99, -16.0): {west, crossing, east},
        (179.0, -17.0, 180.0, -16.0): {west, crossing},
        (-180.0, -17.0, -179.0, -16.0): {crossing, east},
    }
    stac = pystac_client.Client.open(f"{url}/stac")
    for box, expected in boxes.items():
        assert {item.id for item in stac.search(bbox=box).items()} == expected
    for (low, south, high, north), expected in list(boxes.items())[1:]:
        box = [str(degrees) for degrees in (low, south, high, north)]
        command = ["ogrinfo", "-ro", "-al", "-q", "-spat", *box, f"OAPIF:{url}/ogc/collections/dem"]
        answer = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert answer.returncode == 0, answer.stderr
        assert {found for found in (west, crossing, east) if found in answer.stdout} == expected
        assert answer.stdout.count("MULTIPOLYGON") == 1
