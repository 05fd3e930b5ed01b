# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Programs that know nothing of us against the real server: pystac-client, pystac's validation, and GDAL's OAPIF driver
as the wheel of pyogrio has it. The site lies on Mars, and so must everything that they see.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.codecs import encode
from cdff_common.geodesy import Anchor, body
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, TransformWithCovariance
from cdff_dev.ports import free_port
from dpm_store import Parcel, open_store

from .conftest import process_starter, wait_until

pytestmark = pytest.mark.integration

S = 1_000_000_000
LON, LAT = 77.45, 18.44
PATCHES = 25
MARS = body("mars")
IAU = "http://www.opengis.net/def/crs/IAU/2015"


@dataclass(frozen=True)
class Server:
    """A running DPM and what it holds."""

    url: str
    patches: tuple[str, ...]
    turned: str
    lost: str

    def get(self, path: str, **headers: str) -> tuple[int, Any, Any]:
        """Status, headers and JSON of an answer."""
        request = urllib.request.Request(self.url + path, headers=headers)
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return answer.status, answer.headers, json.load(answer)
        except urllib.error.HTTPError as error:
            return error.code, error.headers, json.load(error)


def patch(x0_m: float, frame: str, second: int, robot: str = "mana") -> Parcel:
    """A flat patch of 2 m x 2 m with its lower left corner at (x0, 0)."""
    geometry = GridGeometry(frame, 0.1, x0_m, 2.0, 20, 20)
    one = np.ones(geometry.shape, dtype=np.float32)
    layers = {"mean": one, "variance": one * 0.01, "min": one, "max": one, "count": one, "age_s": one * 0}
    value = ElevationMap.from_layers(geometry, layers, t0_ns=second * S, t1_ns=second * S)
    header = header_of("dem", second, robot, frame, box_m=(x0_m, 0.0, 1.0, x0_m + 2.0, 2.0, 1.0), resolution_m=0.1)
    return Parcel(header, encode(value, "uper"), robot, "mapping", "dem", "dem", "ElevationMap", "uper", value)


def pose(second: int) -> Parcel:
    """The base at ``(second, 0, 0)`` of the site."""
    T = UncertainTransform(se3.transform(np.eye(3), [float(second), 0.0, 0.0]), np.eye(6) * 0.01)
    value = TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=second * S)
    header = header_of(
        "pose", second, "mana", "site", child="mana/base", box_m=(float(second), 0.0, 0.0, float(second), 0.0, 0.0)
    )
    return Parcel(header, encode(value, "uper"), "mana", "mapping", "pose", "pose", "TransformWithCovariance")


def header_of(port: str, second: int, robot: str, frame: str, **fields: Any) -> Header:
    """A header of one moment."""
    made = product_id(robot, "mapping", port, second * S, second, "c")
    return Header(made, second, second * S, second * S, frame, "mapping/one/1", config_hash="c", **fields)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A DPM process over a filled store, its site on Mars."""
    folder = tmp_path_factory.mktemp("clients")
    along = [patch(2.0 * i, "site", i) for i in range(PATCHES)]
    turned, lost = patch(0.0, "minnie/odom", 100, "minnie"), patch(0.0, "nobody/odom", 101, "nobody")
    with open_store(f"sqlite:///{folder / 'data'}", ManualClock(200 * S)) as store:
        store.places.anchor("site", Anchor(MARS, LON, LAT))
        quarter = UncertainTransform(se3.transform(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), [10.0, 20.0, 0.0]))
        store.frames.set("minnie/odom", "site", quarter)
        store.put_all([*along, turned, lost, *(pose(second) for second in range(5))])
    port, endpoint = free_port(), f"tcp/127.0.0.1:{free_port()}"
    with process_starter(endpoint, folder) as start:
        start("services.router")
        start("services.dpm", "--http", f"127.0.0.1:{port}", "--data-dir", str(folder / "data"))
        url = f"http://127.0.0.1:{port}"
        wait_until(lambda: _ready(url), 60, "the DPM")
        yield Server(url, tuple(p.header.id for p in along), turned.header.id, lost.header.id)


def _ready(url: str) -> bool:
    try:
        with urllib.request.urlopen(f"{url}/readyz", timeout=2) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def lon_lat(x_m: float, y_m: float) -> tuple[float, float]:
    """Where a point of the site lies on Mars, computed without our code: on a sphere, near its tangent point."""
    radius = 3_396_190.0
    lon = LON + np.degrees(x_m / (radius * np.cos(np.radians(LAT))))
    return float(lon), float(LAT + np.degrees(y_m / radius))


# --- STAC ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stac(server: Server) -> Any:
    pystac_client = pytest.importorskip("pystac_client", reason="pystac-client is not installed")
    return pystac_client.Client.open(f"{server.url}/stac")


@pytest.mark.req("CDFF-SUP-160")
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_pystac_client_finds_every_item_once_over_all_pages(stac: Any, server: Server, method: str) -> None:
    found = [i.id for i in stac.search(collections=["dem"], limit=10, method=method).items()]
    assert sorted(found) == sorted([*server.patches, server.turned, server.lost])
    assert {c.id for c in stac.get_collections()} == {"dem", "pose"}


@pytest.mark.parametrize("method", ["GET", "POST"])
def test_pystac_client_searches_by_place_time_and_id(stac: Any, server: Server, method: str) -> None:
    (west, south), (east, north) = lon_lat(4.5, 0.5), lon_lat(7.5, 1.0)
    by_box = stac.search(collections=["dem"], bbox=[west, south, east, north], method=method)
    assert {i.id for i in by_box.items()} == set(server.patches[2:4])
    corner = [list(lon_lat(x, y)) for x, y in ((0.1, 0.1), (1.9, 0.1), (0.1, 1.9), (0.1, 0.1))]
    triangle = {"type": "Polygon", "coordinates": [corner]}
    assert {i.id for i in stac.search(collections=["dem"], intersects=triangle, method=method).items()} == {
        server.patches[0]
    }
    when = "1970-01-01T00:00:03Z/1970-01-01T00:00:05Z"
    assert {i.id for i in stac.search(collections=["dem"], datetime=when, method=method, limit=2).items()} == set(
        server.patches[3:6]
    )
    assert [i.id for i in stac.search(ids=[server.lost], method=method).items()] == [server.lost]
    world = [-180.0, -90.0, 180.0, 90.0]
    anywhere = {i.id for i in stac.search(collections=["dem"], bbox=world, method=method).items()}
    assert anywhere == {*server.patches, server.turned}


@pytest.mark.req("CDFF-SUP-160")
def test_items_collections_and_catalog_are_valid_stac(stac: Any, server: Server) -> None:
    from pystac.validation import validate_dict

    items = list(stac.search(ids=[server.patches[0], server.turned, server.lost]).items())
    assert len(items) == 3
    for data in (stac.to_dict(), *(c.to_dict() for c in stac.get_collections()), *(i.to_dict() for i in items)):
        # The schemas of extensions lie on the web; their fields are looked at below.
        assert validate_dict(data | {"stac_extensions": []})


def test_an_item_lies_on_mars_where_its_product_does(stac: Any, server: Server) -> None:
    import pyproj
    from pystac.extensions.projection import ProjectionExtension

    (item,) = stac.search(ids=[server.turned]).items()
    projection = ProjectionExtension.ext(item)
    plane = pyproj.CRS.from_wkt(projection.wkt2)
    assert plane == pyproj.CRS.from_json_dict(projection.projjson)
    assert plane.ellipsoid.semi_major_metre == 3_396_190.0
    assert projection.bbox == [0.0, 0.0, 2.0, 2.0]
    to_degrees = pyproj.Transformer.from_crs(plane, "IAU_2015:49900", always_xy=True)
    computed = np.column_stack(to_degrees.transform(*np.array(projection.geometry["coordinates"][0]).T))
    assert np.allclose(computed, item.geometry["coordinates"][0], rtol=0, atol=1e-9)
    # It is turned by a quarter: (2, 0) of its frame is (10, 22) of the site.
    corners = np.array(item.geometry["coordinates"][0])
    assert np.abs(corners - lon_lat(10.0, 22.0)).max(axis=1).min() < 1e-9
    assert ProjectionExtension.ext(item.assets["footprint"]).code == "IAU_2015:49900"
    assert item.properties["ssys:targets"] == ["Mars"]


def test_an_item_of_a_frame_that_lies_nowhere_has_a_place_in_metres(stac: Any, server: Server) -> None:
    (item,) = stac.search(ids=[server.lost]).items()
    assert (item.geometry, item.bbox) == (None, None)
    assert item.properties["proj:bbox"] == [0.0, 0.0, 2.0, 2.0]
    assert "nobody/odom" in item.properties["proj:wkt2"]


def test_assets_are_what_they_say(stac: Any, server: Server) -> None:
    (item,) = stac.search(ids=[server.patches[0]]).items()
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


def test_stac_conforms_to_what_it_says_and_names_its_links(server: Server) -> None:
    _, _, landing = server.get("/stac")
    assert {
        "https://api.stacspec.org/v1.0.0/core",
        "https://api.stacspec.org/v1.0.0/item-search",
    } <= set(landing["conformsTo"])
    assert landing["conformsTo"] == server.get("/stac/conformance")[2]["conformsTo"]
    for link in landing["links"]:
        if link["rel"] not in ("search", "service-doc"):
            assert server.get(link["href"].removeprefix(server.url))[0] == 200


# --- OGC API Features ------------------------------------------------------------------------------------------------

_GDAL = """
import json, sys
from pyogrio import list_layers, read_info
from pyogrio.raw import read
import shapely

url, box = "OAPIF:" + sys.argv[1] + "/ogc", json.loads(sys.argv[2])
told = {"layers": dict(list_layers(url).tolist())}
for layer in told["layers"]:
    meta, _, geometry, data = read(url, layer=layer)
    read_ = [shapely.from_wkb(g) for g in geometry]
    ids = data[list(meta["fields"]).index("id")].tolist()
    told[layer] = {"crs": meta["crs"], "ids": ids, "wkt": [None if g is None else g.wkt for g in read_]}
meta, _, geometry, data = read(url, layer="dem", bbox=tuple(box))
told["in_box"] = data[list(meta["fields"]).index("id")].tolist()
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def gdal(server: Server) -> dict[str, Any]:
    """What GDAL reads, in a process of its own: rasterio brings another GDAL."""
    pytest.importorskip("pyogrio", reason="pyogrio, and with it a GDAL of these years, is not installed")
    (west, south), (east, north) = lon_lat(4.5, 0.5), lon_lat(7.5, 1.0)
    command = [sys.executable, "-c", _GDAL, server.url, json.dumps([west, south, east, north])]
    done = subprocess.run(command, capture_output=True, text=True, timeout=90, check=False)
    assert done.returncode == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def test_gdal_reads_every_layer_and_every_feature(gdal: dict[str, Any], server: Server) -> None:
    assert gdal["layers"] == {"dem": "Polygon", "pose": "Point", "trajectories": "LineString"}
    assert sorted(gdal["dem"]["ids"]) == sorted([*server.patches, server.turned, server.lost])
    assert len(gdal["pose"]["ids"]) == 5
    assert len(gdal["trajectories"]["ids"]) == 1


@pytest.mark.req("CDFF-SUP-160")
def test_gdal_says_that_it_is_mars(gdal: dict[str, Any]) -> None:
    import pyproj

    for layer in gdal["layers"]:
        crs = pyproj.CRS.from_user_input(gdal[layer]["crs"])
        assert crs.ellipsoid.semi_major_metre == 3_396_190.0
        assert "Mars" in crs.name
        assert '"49900"' in gdal[layer]["crs"]


def test_gdal_puts_features_where_they_are_with_longitude_as_x(gdal: dict[str, Any], server: Server) -> None:
    import shapely

    places = dict(zip(gdal["dem"]["ids"], gdal["dem"]["wkt"], strict=True))
    outline = shapely.from_wkt(places[server.patches[3]])
    assert np.allclose(outline.bounds, [*lon_lat(6.0, 0.0), *lon_lat(8.0, 2.0)], rtol=0, atol=1e-9)
    assert places[server.lost] is None  # its outline is told in metres of its frame
    _, _, lost = server.get(f"/ogc/collections/dem/items/{server.lost}")
    assert lost["geometry"] is None
    assert lost["properties"]["outline_m"] == "POLYGON ((0 0, 2 0, 2 2, 0 2, 0 0))"
    line = shapely.from_wkt(gdal["trajectories"]["wkt"][0])
    assert np.allclose(np.array(line.coords)[[0, -1]], [lon_lat(0.0, 0.0), lon_lat(4.0, 0.0)], rtol=0, atol=1e-9)


def test_gdal_filters_by_a_box_in_the_crs_of_mars(gdal: dict[str, Any], server: Server) -> None:
    assert set(gdal["in_box"]) == set(server.patches[2:4])


def test_coordinates_come_in_any_crs_of_the_collection_and_in_its_order(server: Server) -> None:
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
    named = "" if code is None else f"&bbox-crs={IAU}/{code}"
    _, _, found = server.get(f"/ogc/collections/dem/items?bbox={','.join(map(repr, box))}{named}")
    assert {f["id"] for f in found["features"]} == set(server.patches[2:4])


def test_pages_of_features_are_linked_in_body_and_header(server: Server) -> None:
    seen: list[str] = []
    url: str | None = "/ogc/collections/dem/items?limit=10"
    while url is not None:
        _, headers, page = server.get(url)
        seen += [feature["id"] for feature in page["features"]]
        following = [link["href"] for link in page["links"] if link["rel"] == "next"]
        assert [f'<{href}>; rel="next"' in headers["Link"] for href in following] == [True] * len(following)
        url = following[0].removeprefix(server.url) if following else None
    assert len(seen) == len(set(seen)) == PATCHES + 2


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
def test_what_the_standards_call_bad_is_400_with_the_reason(server: Server, path: str) -> None:
    status, headers, problem = server.get(path)
    assert status == 400
    assert headers["Content-Type"] == "application/problem+json"
    assert problem["detail"]
