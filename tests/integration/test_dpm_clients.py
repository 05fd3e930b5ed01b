# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Independent clients of the real DPM server: pystac-client, pystac's validation, GDAL's OAPIF driver (from
pyogrio). The site is on Mars, so every coordinate reference system that they read must be one of Mars.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import shutil
import subprocess
import sys
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from PIL import Image

from cdff_common.clock import ManualClock
from cdff_common.codecs import encode, encoding_string
from cdff_common.geodesy import Anchor, body
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, TransformWithCovariance
from cdff_dev.ports import free_port
from dpm_store import NewProduct, open_store
from services.dpm.operations.work_budget import TOTAL_BYTES

from .conftest import process_starter, wait_until

pytestmark = pytest.mark.integration

S = 1_000_000_000
LON, LAT = 77.45, 18.44
PATCHES = 25
MARS = body("mars")
IAU = "http://www.opengis.net/def/crs/IAU/2015"


@dataclass(frozen=True)
class Server:
    """A running DPM and the ids of its products."""

    url: str
    process_id: int
    patches: tuple[str, ...]
    rotated: str
    unanchored: str

    def get(self, path: str, **headers: str) -> tuple[int, Any, Any]:
        """Return status, headers and JSON of the response."""
        return self._answer(urllib.request.Request(self.url + path, headers=headers))

    def post_product(self, product: NewProduct, header: dict[str, Any]) -> tuple[int, Any, Any]:
        """Insert a product with a header of its own; return status, headers and JSON of the response."""
        names = {name: getattr(product, name) for name in ("robot", "dfpc", "port", "product")}
        url = f"{self.url}/api/v1/products?{urllib.parse.urlencode(names)}"
        encoding = encoding_string(product.type_name, "uper")
        headers = {"Content-Type": encoding, "CDFF-Header": json.dumps(header)}
        return self._answer(urllib.request.Request(url, product.payload, headers, method="POST"))

    @staticmethod
    def _answer(request: urllib.request.Request) -> tuple[int, Any, Any]:
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                return answer.status, answer.headers, json.load(answer)
        except urllib.error.HTTPError as error:
            return error.code, error.headers, json.load(error)


def patch(x0_m: float, frame: str, second: int, robot: str = "mana") -> NewProduct:
    """Return a flat patch of 2 m × 2 m with its lower left corner at (x0, 0)."""
    geometry = GridGeometry(frame, 0.1, x0_m, 2.0, 20, 20)
    one = np.ones(geometry.shape, dtype=np.float32)
    layers = {"mean": one, "variance": one * 0.01, "min": one, "max": one, "count": one, "age_s": one * 0}
    value = ElevationMap.from_layers(geometry, layers, t0_ns=second * S, t1_ns=second * S)
    header = header_of(
        "dem", second, robot, frame, box_m=(x0_m, 0.0, 1.0, x0_m + 2.0, 2.0, 1.0), resolution_m=0.1
    )
    return NewProduct(
        header, encode(value, "uper"), robot, "mapping", "dem", "dem", "ElevationMap", "uper", value
    )


def pose(second: int) -> NewProduct:
    """Return a pose of the base at ``(second, 0, 0)`` m in the site frame."""
    T = UncertainTransform(se3.transform(np.eye(3), [float(second), 0.0, 0.0]), np.eye(6) * 0.01)
    value = TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=second * S)
    header = header_of(
        "pose",
        second,
        "mana",
        "site",
        child="mana/base",
        box_m=(float(second), 0.0, 0.0, float(second), 0.0, 0.0),
    )
    return NewProduct(
        header, encode(value, "uper"), "mana", "mapping", "pose", "pose", "TransformWithCovariance"
    )


def header_of(port: str, second: int, robot: str, frame: str, **fields: Any) -> Header:
    """Return a header with one capture time."""
    identifier = product_id(robot, "mapping", port, second * S, second, "c")
    return Header(
        identifier, second, second * S, second * S, frame, "mapping/one/1", config_hash="c", **fields
    )


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A DPM process with a filled store; the site is anchored on Mars."""
    folder = tmp_path_factory.mktemp("clients")
    anchored = [patch(2.0 * i, "site", i) for i in range(PATCHES)]
    rotated, unanchored = (
        patch(0.0, "minnie/odom", 100, "minnie"),
        patch(0.0, "unplaced/odom", 101, "unplaced"),
    )
    with open_store(f"sqlite:///{folder / 'data'}", ManualClock(200 * S)) as store:
        store.anchors.anchor("site", Anchor(MARS, LON, LAT))
        quarter_turn = UncertainTransform(
            se3.transform(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), [10.0, 20.0, 0.0])
        )
        store.frames.set("minnie/odom", "site", quarter_turn)
        store.put_all([*anchored, rotated, unanchored, *(pose(second) for second in range(5))])
    port, endpoint = free_port(), f"tcp/127.0.0.1:{free_port()}"
    with process_starter(endpoint, folder) as start:
        start("services.router")
        dpm = start("services.dpm", "--http", f"127.0.0.1:{port}", "--data-dir", str(folder / "data"))
        url = f"http://127.0.0.1:{port}"
        wait_until(lambda: _ready(url), 180, "the DPM")
        yield Server(
            url, dpm.pid, tuple(p.header.id for p in anchored), rotated.header.id, unanchored.header.id
        )


def _ready(url: str) -> bool:
    try:
        with urllib.request.urlopen(f"{url}/readyz", timeout=2) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def lon_lat(x_m: float, y_m: float) -> tuple[float, float]:
    """Return longitude and latitude of a site point, in degrees, computed without the tested code: on a
    sphere, near its tangent point.
    """
    radius = 3_396_190.0
    lon = LON + np.degrees(x_m / (radius * np.cos(np.radians(LAT))))
    return float(lon), float(LAT + np.degrees(y_m / radius))


# --- STAC
# ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stac(server: Server) -> Any:
    pystac_client = pytest.importorskip("pystac_client", reason="pystac-client is not installed")
    return pystac_client.Client.open(f"{server.url}/stac")


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-160")
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_pystac_client_finds_every_item_once_over_all_pages(stac: Any, server: Server, method: str) -> None:
    results = [i.id for i in stac.search(collections=["dem"], limit=10, method=method).items()]
    assert sorted(results) == sorted([*server.patches, server.rotated, server.unanchored])
    assert {c.id for c in stac.get_collections()} == {"dem", "pose"}


def test_pystac_client_walks_the_collections_and_knows_the_number_of_items(stac: Any, server: Server) -> None:
    dem = stac.get_collection("dem")
    everything = {*server.patches, server.rotated, server.unanchored}
    assert {i.id for i in dem.get_items()} == everything
    assert dem.get_item(server.rotated).id == server.rotated
    assert len(list(stac.get_items(recursive=True))) == len(everything) + 5
    assert stac.search(collections=["dem"], limit=10).matched() == len(everything)
    (west, south), (east, north) = lon_lat(4.5, 0.5), lon_lat(7.5, 1.0)
    assert stac.search(collections=["dem"], bbox=[west, south, east, north]).matched() == 2


@pytest.mark.parametrize("method", ["GET", "POST"])
def test_pystac_client_searches_by_region_time_and_id(stac: Any, server: Server, method: str) -> None:
    (west, south), (east, north) = lon_lat(4.5, 0.5), lon_lat(7.5, 1.0)
    by_box = stac.search(collections=["dem"], bbox=[west, south, east, north], method=method)
    assert {i.id for i in by_box.items()} == set(server.patches[2:4])
    corner = [list(lon_lat(x, y)) for x, y in ((0.1, 0.1), (1.9, 0.1), (0.1, 1.9), (0.1, 0.1))]
    triangle = {"type": "Polygon", "coordinates": [corner]}
    assert {i.id for i in stac.search(collections=["dem"], intersects=triangle, method=method).items()} == {
        server.patches[0]
    }
    interval = "1970-01-01T00:00:03Z/1970-01-01T00:00:05Z"
    assert {
        i.id for i in stac.search(collections=["dem"], datetime=interval, method=method, limit=2).items()
    } == set(server.patches[3:6])
    assert [i.id for i in stac.search(ids=[server.unanchored], method=method).items()] == [server.unanchored]
    world = [-180.0, -90.0, 180.0, 90.0]
    ids_in_world = {i.id for i in stac.search(collections=["dem"], bbox=world, method=method).items()}
    assert ids_in_world == {*server.patches, server.rotated}


@pytest.mark.parametrize("method", ["GET", "POST"])
def test_pystac_client_filters_sorts_and_searches_collections(stac: Any, server: Server, method: str) -> None:
    text = "platform = 'minnie' AND gsd <= 0.1"
    assert [i.id for i in stac.search(filter=text, filter_lang="cql2-text", method=method).items()] == [
        server.rotated
    ]
    later = {"op": ">=", "args": [{"property": "datetime"}, {"timestamp": "1970-01-01T00:01:40Z"}]}
    items = stac.search(filter=later, filter_lang="cql2-json", method="POST").items()
    assert {i.id for i in items} == {server.rotated, server.unanchored}
    oldest = stac.search(collections=["dem"], sortby=["+datetime"], max_items=3, method=method)
    assert [i.id for i in oldest.items()] == list(server.patches[:3])
    short = stac.search(ids=[server.rotated], fields=["platform", "-assets"], method=method)
    (item,) = short.items_as_dicts()
    assert (item["properties"]["platform"], "assets" in item) == ("minnie", False)
    search = stac.collection_search(q="elevation")
    assert search.matched() == 1
    assert [c.id for c in search.collections()] == ["dem"]


@pytest.mark.req("CDFF-SUP-160")
def test_items_collections_and_catalog_are_valid_stac(stac: Any, server: Server) -> None:
    from pystac.validation import validate_dict

    items = list(stac.search(ids=[server.patches[0], server.rotated, server.unanchored]).items())
    assert len(items) == 3
    for data in (
        stac.to_dict(),
        *(c.to_dict() for c in stac.get_collections()),
        *(i.to_dict() for i in items),
    ):
        # The schemas of extensions are on the web; the tests below check the fields of the extensions.
        assert validate_dict(data | {"stac_extensions": []})


def test_an_item_on_mars_has_the_coordinates_of_its_product(stac: Any, server: Server) -> None:
    import pyproj
    from pystac.extensions.projection import ProjectionExtension

    item = stac.get_collection("dem").get_item(server.rotated)
    (listed,) = stac.search(ids=[server.rotated], fields=["properties"]).items()
    assert listed.properties == item.properties
    projection = ProjectionExtension.ext(item)
    projected_crs = pyproj.CRS.from_wkt(projection.wkt2)
    assert projected_crs == pyproj.CRS.from_json_dict(projection.projjson)
    assert projected_crs.ellipsoid.semi_major_metre == 3_396_190.0
    assert np.allclose(projection.bbox, [-2.0, 0.0, 0.0, 2.0], rtol=0, atol=1e-5)  # a quarter turn
    to_degrees = pyproj.Transformer.from_crs(projected_crs, "IAU_2015:49900", always_xy=True)
    computed = np.column_stack(to_degrees.transform(*np.array(projection.geometry["coordinates"][0]).T))
    assert np.allclose(computed, item.geometry["coordinates"][0], rtol=0, atol=2e-9)
    # The frame is rotated by 90°: its point (2, 0) is (10, 22) in the site frame. Lists have 9 decimals.
    corners = np.array(item.geometry["coordinates"][0])
    assert np.abs(corners - lon_lat(10.0, 22.0)).max(axis=1).min() < 2e-9
    assert ProjectionExtension.ext(item.assets["footprint"]).code == "IAU_2015:49900"
    assert item.properties["ssys:targets"] == ["Mars"]


def test_an_item_of_an_unanchored_frame_has_a_box_in_metres(stac: Any, server: Server) -> None:
    item = stac.get_collection("dem").get_item(server.unanchored)
    assert (item.geometry, item.bbox) == (None, None)
    assert item.properties["proj:bbox"] == [0.0, 0.0, 2.0, 2.0]
    assert "unplaced/odom" in item.properties["proj:wkt2"]


def test_assets_have_their_stated_media_type_and_size(stac: Any, server: Server) -> None:
    item = stac.get_collection("dem").get_item(server.patches[0])
    for name, magic in (("payload", b""), ("tif", b"II"), ("thumbnail", b"\x89PNG"), ("footprint", b"{")):
        asset = item.assets[name]
        with urllib.request.urlopen(asset.href, timeout=20) as answer:
            data = answer.read()
            assert answer.headers["Content-Type"] == asset.media_type
        assert data.startswith(magic)
    with urllib.request.urlopen(item.assets["payload"].href, timeout=20) as answer:
        data = answer.read()
    extra = item.assets["payload"].extra_fields
    assert extra["file:size"] == len(data)
    assert extra["file:checksum"] == "1220" + hashlib.sha256(data).hexdigest()


def test_stac_declares_its_conformance_classes_and_every_link_works(server: Server) -> None:
    _, _, landing = server.get("/stac")
    assert {
        "https://api.stacspec.org/v1.0.0/core",
        "https://api.stacspec.org/v1.0.0/item-search",
    } <= set(landing["conformsTo"])
    assert landing["conformsTo"] == server.get("/stac/conformance")[2]["conformsTo"]
    for link in landing["links"]:
        if link["rel"] not in ("search", "service-doc"):
            assert server.get(link["href"].removeprefix(server.url))[0] == 200


@pytest.mark.slow
def test_stac_api_validator_finds_no_error(server: Server) -> None:
    pytest.importorskip("stac_api_validator", reason="stac-api-validator is not installed")
    (west, south), (east, north) = lon_lat(0.0, 0.0), lon_lat(50.0, 2.0)
    corners = [[west, south], [east, south], [east, north], [west, north], [west, south]]
    geometry = json.dumps({"type": "Polygon", "coordinates": [corners]})
    script = Path(__file__).parents[1] / "support" / "stac_validation.py"
    command = [sys.executable, str(script), f"{server.url}/stac", geometry]
    result = subprocess.run(command, capture_output=True, text=True, timeout=90, check=False)
    output = result.stdout + result.stderr
    assert "Validating STAC API - Item Search conformance class" in output
    assert "Errors: none" in output, output
    assert result.returncode == 0, output


# --- Files by their URL
# ----------------------------------------------------------------------------------------------


def test_rasterio_reads_a_part_of_a_converted_file_by_its_url(server: Server) -> None:
    import rasterio

    _, _, item = server.get(f"/stac/collections/dem/items/{server.rotated}")
    asset = item["assets"]["tif"]
    assert asset["type"] == "image/tiff; application=geotiff; profile=cloud-optimized"
    with rasterio.open(asset["href"]) as file:
        assert file.read(1, window=((0, 5), (0, 5))).shape == (5, 5)
        assert file.crs.to_wkt().startswith('PROJCS["Site on mars')
    request = urllib.request.Request(asset["href"], headers={"Range": "bytes=0-3"})
    with urllib.request.urlopen(request, timeout=20) as answer:
        assert (answer.status, answer.read()[:2]) == (206, b"II")
        assert answer.headers["ETag"]


def test_gdal_3_6_locates_a_map_of_a_turned_frame(server: Server) -> None:
    if shutil.which("gdalinfo") is None:
        pytest.skip("gdalinfo is not installed; make peers installs it")
    url = f"/vsicurl/{server.url}/api/v1/products/{server.rotated}/payload?format=tif"
    result = subprocess.run(
        ["gdalinfo", "-json", url], capture_output=True, text=True, timeout=60, check=True
    )
    document = json.loads(result.stdout)
    # The frame is rotated by 90°: its point (0, 2) is (8, 20) in the site frame.
    (lower_left, upper_left), *_ = [[document["cornerCoordinates"][n] for n in ("lowerLeft", "upperLeft")]]
    assert lower_left == pytest.approx([0.0, 0.0], abs=1e-5)
    assert upper_left == pytest.approx([-2.0, 0.0], abs=1e-5)
    command = ["gdaltransform", "-t_srs", "IAU_2015:49900", "-output_xy", url]
    answer = subprocess.run(command, input="0 0\n", capture_output=True, text=True, timeout=60, check=True)
    lat_lon = [float(v) for v in answer.stdout.split()]
    assert sorted(lat_lon) == pytest.approx(sorted(lon_lat(8.0, 20.0)), abs=1e-9)


def test_owslib_reads_a_tile_in_both_encodings_of_wmts(server: Server) -> None:
    wmts = pytest.importorskip("owslib.wmts", reason="owslib is not installed")
    for address in ("/wmts", "/tiles/wmts.xml", "/wmts/1.0.0/WMTSCapabilities.xml"):
        service = wmts.WebMapTileService(f"{server.url}{address}")
        assert "hillshade" in service.contents
        assert list(service.tilematrixsets) == ["IAU_2015_49910", "grid"]
        mars = service.tilematrixsets["IAU_2015_49910"]
        assert mars.crs == "urn:ogc:def:crs:IAU_2015::49910"
        tile = service.gettile(
            layer="hillshade",
            tilematrixset="grid",
            tilematrix="17",
            row=65535,
            column=65536,
            format="image/png",
        )
        assert tile.read().startswith(b"\x89PNG")
    resource_url = service.contents["hillshade"].resourceURLs[0]["template"]
    resource_url = resource_url.replace("{TileMatrixSet}", "grid").replace("{Time}", "current")
    url = (
        resource_url.replace("{TileMatrix}", "17").replace("{TileRow}", "65535").replace("{TileCol}", "65536")
    )
    with urllib.request.urlopen(url, timeout=20) as answer:
        assert answer.read().startswith(b"\x89PNG")


def test_owslib_selects_a_time_by_the_dimension_of_wmts(server: Server) -> None:
    wmts = pytest.importorskip("owslib.wmts", reason="owslib is not installed")
    service = wmts.WebMapTileService(f"{server.url}/wmts")
    (name,) = service.contents["hillshade"].dimensions
    dimension = service.contents["hillshade"].dimensions[name]
    assert (name, dimension["UOM"], dimension["default"]) == ("Time", "ISO8601", "current")
    assert dimension["values"] == ["current", "1970-01-01T00:00:00.000000Z", "1970-01-01T00:01:41.000000Z"]
    tile = {"tilematrixset": "grid", "tilematrix": "17", "row": 65535, "column": 65536, "format": "image/png"}
    observed = {}
    for time in ("current", "1970-01-01T00:00:04Z", "1970-01-01T00:00:05Z/1970-01-01T00:00:06Z"):
        picture = service.gettile(layer="hillshade", **tile, **{name: time}).read()
        alpha = np.asarray(Image.open(io.BytesIO(picture)).convert("RGBA"))[..., 3]
        observed[time] = np.count_nonzero(alpha.any(axis=0)) * 0.1
    # The tile shows 25.6 m; each second adds 2 m of the map.
    assert list(observed.values()) == pytest.approx([25.6, 10.0, 4.0])


def test_gdal_reads_the_tiles_of_the_time_in_the_address_of_the_capabilities(server: Server) -> None:
    import rasterio

    times = {"": 0.9, "?time=1970-01-01T00:00:01Z": 3.0 / 8.0}
    for query, expected in times.items():
        source = f"WMTS:{server.url}/wmts{query},layer=elevation,tilematrixset=IAU_2015_49910"
        with rasterio.open(source) as file:
            alpha = file.read(4, window=file.window(*body_metres(1.0, 0.5), *body_metres(9.0, 1.5)))
        observed = float((alpha == 255).mean())
        assert observed > 0.9 if expected == 0.9 else observed == pytest.approx(expected, abs=0.05)


def body_metres(x_m: float, y_m: float) -> tuple[float, float]:
    """Return x and y in the equirectangular CRS of Mars of a site point."""
    lon, lat = lon_lat(x_m, y_m)
    return math.radians(lon) * 3_396_190.0, math.radians(lat) * 3_396_190.0


def test_gdal_places_the_tiles_on_mars_by_the_name_of_their_crs(server: Server) -> None:
    import rasterio

    source = f"WMTS:{server.url}/wmts,layer=elevation,tilematrixset=IAU_2015_49910"
    with rasterio.open(source) as file:
        assert "Mars (2015) - Sphere / Ocentric / Equirectangular" in file.crs.to_wkt()
        (west, south), (east, north) = body_metres(-5.0, -5.0), body_metres(55.0, 25.0)
        bounds = file.bounds
        assert west < bounds.left < bounds.right < east
        assert south < bounds.bottom < bounds.top < north
        window = file.window(*body_metres(1.0, 0.5), *body_metres(9.0, 1.5))
        alpha = file.read(4, window=window)
        assert alpha.size > 100
        assert (alpha == 255).mean() > 0.9
    if shutil.which("gdalinfo") is None:
        pytest.skip("gdalinfo is not installed; make peers installs it")
    command = ["gdalinfo", "-json", source]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert "Mars (2015)" in json.loads(result.stdout)["coordinateSystem"]["wkt"]


@pytest.mark.slow
def test_gdal_reads_the_tiles_of_ogc_api(server: Server) -> None:
    pytest.importorskip("pyogrio", reason="pyogrio, which contains a recent GDAL, is not installed")
    (west, south), (east, north) = body_metres(1.0, 0.2), body_metres(2.6, 1.8)
    box = [f"MINX={west}", f"MINY={south}", f"MAXX={east}", f"MAXY={north}"]
    script = Path(__file__).parents[1] / "support" / "gdal_tiles.py"
    collection = f"OGCAPI:{server.url}/ogc/collections/dem"
    command = [sys.executable, str(script), collection, "API=TILES", "CACHE=NO", *box]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert answer.returncode == 0, answer.stderr
    result = json.loads(answer.stdout)
    assert "Mars (2015) - Sphere / Ocentric / Equirectangular" in result["crs"]
    assert result["error"] == 0
    assert result["observed"] > 0.9


@pytest.mark.slow
def test_a_recent_gdal_opens_the_coverage(server: Server) -> None:
    pytest.importorskip("pyogrio", reason="pyogrio, which contains a recent GDAL, is not installed")
    script = Path(__file__).parents[1] / "support" / "gdal_tiles.py"
    collection = f"OGCAPI:{server.url}/ogc/collections/dem"
    command = [sys.executable, str(script), collection, "API=COVERAGE", "CACHE=NO"]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert answer.returncode == 0, answer.stderr
    result = json.loads(answer.stdout)
    assert result["error"] == 0
    assert result["observed"] > 0.8  # the largest height of each cell, 1 m, as a byte


def test_gdal_3_6_reads_the_values_of_a_coverage(server: Server, tmp_path: Path) -> None:
    """The driver calls every CRS WGS 84; the longitudes and latitudes are those of Mars."""
    import rasterio

    if shutil.which("gdal_translate") is None:
        pytest.skip("gdal_translate is not installed; make peers installs it")
    source, target = f"OGCAPI:{server.url}/ogc/collections/dem", tmp_path / "coverage.tif"
    options = ["-oo", "API=COVERAGE", "-oo", "CACHE=NO"]
    command = ["gdal_translate", "-q", source, str(target), *options]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=90, check=False)
    assert answer.returncode == 0, answer.stderr
    with rasterio.open(target) as file:
        assert file.count == 6
        west, south = lon_lat(0.0, 0.0)
        east, north = lon_lat(2.0 * PATCHES, 2.0)
        assert file.bounds == pytest.approx((west, south, east, north), abs=2e-6)
        heights, variances = file.read(1), file.read(2)
    inner = np.s_[1:-1, 1:-1]
    assert heights.shape[1] > 10 * heights.shape[0]
    np.testing.assert_allclose(heights[inner], 1.0)
    np.testing.assert_allclose(variances[inner], 0.01, rtol=1e-5)


def test_gdal_3_6_reads_features_by_both_of_its_drivers(server: Server) -> None:
    if shutil.which("ogrinfo") is None:
        pytest.skip("ogrinfo is not installed; make peers installs it")
    for driver, options in (("OAPIF", []), ("OGCAPI", ["-oo", "API=ITEMS"])):
        command = ["ogrinfo", "-ro", "-al", "-so", f"{driver}:{server.url}/ogc/collections/dem", *options]
        answer = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert answer.returncode == 0, answer.stderr
        assert f"Feature Count: {PATCHES + 2}" in answer.stdout


def test_qgis_shows_the_tiles_files_and_features(server: Server) -> None:
    python = "/usr/bin/python3"
    has_qgis = [python, "-c", "import qgis.core"]
    if not Path(python).exists() or subprocess.run(has_qgis, capture_output=True, check=False).returncode:
        pytest.skip("QGIS is not installed; make peers installs it")
    box = [repr(v) for v in (*body_metres(1.0, 0.2), *body_metres(2.6, 1.8))]
    script = Path(__file__).parents[1] / "support" / "qgis_client.py"
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(Path.home())}
    command = [python, str(script), server.url, server.patches[0], *box]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=90, check=False, env=environment)
    assert answer.returncode == 0, answer.stderr
    result = json.loads(answer.stdout.splitlines()[-1])
    assert result["wmts"]["valid"], result
    assert result["wmts"]["crs"] == "IAU_2015:49910"
    assert result["wmts"]["drawn"] > 0.9
    # The first patch, of second 0, ends at x = 2 m: 1.0 of the 1.6 m of the box.
    assert result["wmts"]["drawn_at_the_start"] == pytest.approx(1.0 / 1.6, abs=0.05)
    assert (result["cog"]["valid"], result["cog"]["bands"]) == (True, 6)
    assert "Mars" in result["cog"]["crs"]
    assert result["features"] == {"valid": True, "count": PATCHES + 2}


@pytest.mark.parametrize(
    "pairs",
    [
        "SERVICE=WMS",
        "REQUEST=GetFeatureInfo",
        "REQUEST=GetCapabilities&TIME=yesterday",
        "REQUEST=GetTile&LAYER=nonsense&TILEMATRIX=1&TILEROW=0&TILECOL=0",
        "REQUEST=GetTile&LAYER=dem&TILEMATRIX=1&TILEROW=2&TILECOL=0",
        "REQUEST=GetTile&LAYER=dem&TILEMATRIX=1&TILEROW=-1&TILECOL=0",
        "REQUEST=GetTile&LAYER=dem&TILEMATRIX=1&TILEROW=0&TILECOL=0&FORMAT=image/jpeg",
    ],
)
def test_a_refused_wmts_request_is_answered_with_an_exception_report(server: Server, pairs: str) -> None:
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(f"{server.url}/wmts?service=WMTS&{pairs}", timeout=20)
    body = refused.value.read()
    assert refused.value.code == 400
    assert b"ExceptionReport" in body
    assert b"InvalidParameterValue" in body


# --- OGC API Features
# ------------------------------------------------------------------------------------------------

_GDAL = """
import json, sys
from pyogrio import list_layers, read_info
from pyogrio.raw import read
import shapely

url, box = "OAPIF:" + sys.argv[1] + "/ogc", json.loads(sys.argv[2])
result = {"layers": dict(list_layers(url).tolist())}
for layer in result["layers"]:
    meta, _, geometry, data = read(url, layer=layer)
    shapes = [shapely.from_wkb(g) for g in geometry]
    ids = data[list(meta["fields"]).index("id")].tolist()
    result[layer] = {"crs": meta["crs"], "ids": ids, "wkt": [None if g is None else g.wkt for g in shapes]}
meta, _, geometry, data = read(url, layer="dem", bbox=tuple(box))
result["in_box"] = data[list(meta["fields"]).index("id")].tolist()
print(json.dumps(result))
"""


@pytest.fixture(scope="module")
def gdal(server: Server) -> dict[str, Any]:
    """The features that GDAL reads, in a separate process because rasterio contains another GDAL."""
    pytest.importorskip("pyogrio", reason="pyogrio, which contains a recent GDAL, is not installed")
    (west, south), (east, north) = lon_lat(4.5, 0.5), lon_lat(7.5, 1.0)
    command = [sys.executable, "-c", _GDAL, server.url, json.dumps([west, south, east, north])]
    result = subprocess.run(command, capture_output=True, text=True, timeout=90, check=False)
    assert result.returncode == 0, result.stderr
    document: dict[str, Any] = json.loads(result.stdout)
    return document


def test_gdal_reads_every_layer_and_every_feature(gdal: dict[str, Any], server: Server) -> None:
    assert gdal["layers"] == {"dem": "Polygon", "pose": "Point", "trajectories": "LineString"}
    assert sorted(gdal["dem"]["ids"]) == sorted([*server.patches, server.rotated, server.unanchored])
    assert len(gdal["pose"]["ids"]) == 5
    assert len(gdal["trajectories"]["ids"]) == 1


@pytest.mark.req("CDFF-SUP-160")
def test_gdal_recognises_the_crs_of_mars(gdal: dict[str, Any]) -> None:
    import pyproj

    for layer in gdal["layers"]:
        crs = pyproj.CRS.from_user_input(gdal[layer]["crs"])
        assert crs.ellipsoid.semi_major_metre == 3_396_190.0
        assert "Mars" in crs.name
        assert '"49900"' in gdal[layer]["crs"]


def test_gdal_reads_feature_coordinates_with_longitude_as_x(gdal: dict[str, Any], server: Server) -> None:
    import shapely

    outlines = dict(zip(gdal["dem"]["ids"], gdal["dem"]["wkt"], strict=True))
    outline = shapely.from_wkt(outlines[server.patches[3]])
    assert np.allclose(outline.bounds, [*lon_lat(6.0, 0.0), *lon_lat(8.0, 2.0)], rtol=0, atol=1e-9)
    assert outlines[server.unanchored] is None  # the frame has no anchor, hence no geographic outline
    _, _, feature = server.get(f"/ogc/collections/dem/items/{server.unanchored}")
    assert feature["geometry"] is None
    assert feature["properties"]["outline_m"] == "POLYGON ((0 0, 2 0, 2 2, 0 2, 0 0))"
    line = shapely.from_wkt(gdal["trajectories"]["wkt"][0])
    assert np.allclose(
        np.array(line.coords)[[0, -1]], [lon_lat(0.0, 0.0), lon_lat(4.0, 0.0)], rtol=0, atol=1e-9
    )


def test_gdal_filters_by_a_box_in_the_crs_of_mars(gdal: dict[str, Any], server: Server) -> None:
    assert set(gdal["in_box"]) == set(server.patches[2:4])


def test_coordinates_are_returned_in_any_crs_of_the_collection_and_its_axis_order(server: Server) -> None:
    import pyproj

    items = f"/ogc/collections/dem/items/{server.patches[3]}"
    _, headers, plain = server.get(items)
    default = server.get("/ogc/collections/dem")[2]["crs"][0]
    assert headers["Content-Crs"] == f"<{default}>"
    lon_first = np.array(plain["geometry"]["coordinates"][0])
    _, headers, swapped = server.get(f"{items}?crs={IAU}/49900")
    assert headers["Content-Crs"] == f"<{IAU}/49900>"
    assert np.array_equal(np.array(swapped["geometry"]["coordinates"][0]), lon_first[:, ::-1])
    _, headers, metres = server.get(f"{items}?crs={IAU}/49910")
    to_metres = pyproj.Transformer.from_crs("IAU_2015:49900", "IAU_2015:49910", always_xy=True)
    expected = np.column_stack(to_metres.transform(*lon_first.T))
    assert np.allclose(np.array(metres["geometry"]["coordinates"][0]), expected, rtol=0, atol=1e-6)
    with urllib.request.urlopen(default, timeout=20) as answer:
        assert pyproj.CRS.from_wkt(answer.read().decode()).axis_info[0].direction == "east"


@pytest.mark.parametrize("code", [None, "49900", "49910"])
def test_a_box_may_be_given_in_any_crs_of_the_collection(server: Server, code: str | None) -> None:
    import pyproj

    (west, south), (east, north) = lon_lat(4.5, 0.5), lon_lat(7.5, 1.0)
    box = [west, south, east, north]
    if code == "49900":
        box = [south, west, north, east]
    elif code == "49910":
        to_metres = pyproj.Transformer.from_crs("IAU_2015:49900", "IAU_2015:49910", always_xy=True)
        box = list(to_metres.transform_bounds(*box))
    crs_parameter = "" if code is None else f"&bbox-crs={IAU}/{code}"
    _, _, result = server.get(f"/ogc/collections/dem/items?bbox={','.join(map(repr, box))}{crs_parameter}")
    assert {f["id"] for f in result["features"]} == set(server.patches[2:4])


def test_pages_of_features_are_linked_in_body_and_header(server: Server) -> None:
    ids: list[str] = []
    url: str | None = "/ogc/collections/dem/items?limit=10"
    while url is not None:
        _, headers, page = server.get(url)
        ids += [feature["id"] for feature in page["features"]]
        next_links = [link["href"] for link in page["links"] if link["rel"] == "next"]
        assert [f'<{href}>; rel="next"' in headers["Link"] for href in next_links] == [True] * len(next_links)
        url = next_links[0].removeprefix(server.url) if next_links else None
    assert len(ids) == len(set(ids)) == PATCHES + 2


@pytest.mark.parametrize(
    "path",
    [
        "/ogc/collections/dem/items?nonsense=1",
        "/ogc/collections/dem/items?bbox=1,2,3",
        "/ogc/collections/dem/items?bbox=1,2,nan,4",
        "/ogc/collections/dem/items?limit=0",
        "/ogc/collections/dem/items?crs=http://www.opengis.net/def/crs/OGC/1.3/CRS84",
        "/ogc/collections/dem/items?bbox=1,2,3,4&bbox-crs=urn:earth",
        "/ogc/collections/dem/items?datetime=yesterday",
        "/stac/search?bbox=1,2,3,4&intersects={}",
        "/stac/search?datetime=../..",
        "/stac/search?token=%00",
    ],
)
def test_invalid_requests_are_answered_with_400_and_the_reason(server: Server, path: str) -> None:
    status, headers, problem = server.get(path)
    assert status == 400
    assert headers["Content-Type"] == "application/problem+json"
    assert problem["detail"]


# --- Refused input and large files
# -----------------------------------------------------------------------------------


def test_a_header_whose_inputs_are_text_is_refused(server: Server) -> None:
    product = patch(500.0, "site", 150)
    header = product.header.to_dict() | {"inputs": "abc", "t0_ns": "150000000000", "t1_ns": "150000000000"}
    status, headers, problem = server.post_product(product, header)
    assert (status, headers["Content-Type"]) == (422, "application/problem+json")
    assert "inputs" in problem["detail"]
    assert server.get(f"/api/v1/products/{product.header.id}")[0] == 404


@pytest.mark.parametrize(("size", "reason"), [(66_000, "at most 20000 characters"), (500_000, "65536 bytes")])
def test_an_address_above_64_kb_is_refused_with_a_problem_document(
    server: Server, size: int, reason: str
) -> None:
    status, headers, problem = server.get("/stac/search?ids=" + "a" * size)
    assert (status, headers["Content-Type"]) == (400, "application/problem+json")
    assert reason in problem["detail"]


@pytest.mark.slow
def test_gdal_opens_a_file_of_150_mb_that_is_converted_in_bounded_memory(server: Server) -> None:
    """All requests together stay within the budget of the server, also if several clients ask at once."""
    import rasterio

    side = 2500
    geometry = GridGeometry("site", 0.05, 1000.0, 0.05 * side, side, side)
    noise = np.random.default_rng(0).normal(size=(side, side)).astype(np.float32)
    bands = {name: np.abs(np.roll(noise, i)) for i, name in enumerate(("mean", "variance", "min", "max"))}
    bands |= {"count": np.ceil(bands["max"] * 10.0), "age_s": bands["min"]}
    value = ElevationMap.from_layers(geometry, bands, t0_ns=150 * S, t1_ns=150 * S)
    bounds = geometry.bounds
    box_m = (bounds[0], bounds[1], float(noise.min()), bounds[2], bounds[3], float(noise.max()))
    header = header_of("large", 150, "mana", "site", box_m=box_m, resolution_m=0.05)
    product = NewProduct(header, encode(value, "uper"), "mana", "mapping", "large", "dem", "ElevationMap")
    assert len(product.payload) > 150_000_000
    fields = header.to_dict() | {"t0_ns": "150000000000", "t1_ns": "150000000000"}
    assert server.post_product(product, fields)[0] == 201
    url = f"/vsicurl/{server.url}/api/v1/products/{header.id}/payload?format=tif"
    window = ((1000, 1100), (2000, 2200))

    def read(_: int) -> Any:
        with rasterio.open(url) as file:
            return file.read([1, 5], window=window)

    process = psutil.Process(server.process_id)
    idle_bytes = process.memory_info().rss
    Path(f"/proc/{server.process_id}/clear_refs").write_text("5", encoding="ascii")  # of the largest memory
    with ThreadPoolExecutor(3) as pool:
        values = list(pool.map(read, range(3)))
    rows = slice(*window[0]), slice(*window[1])
    for read_bands in values:
        np.testing.assert_array_equal(read_bands, [bands["mean"][rows], bands["count"][rows]])
    status = Path(f"/proc/{server.process_id}/status").read_text(encoding="ascii")
    (peak_kb,) = (int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM"))
    added_bytes = peak_kb * 1024 - idle_bytes
    print(f"memory added by three clients: {added_bytes / 1e6:.0f} MB, budget {TOTAL_BYTES / 1e6:.0f} MB")
    assert added_bytes < TOTAL_BYTES
