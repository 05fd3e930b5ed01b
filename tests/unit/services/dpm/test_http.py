# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import io
import json
import re
from collections.abc import Callable

import numpy as np
import pytest
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cdff_common.codecs import decode, encode
from cdff_common.interfaces.product import Header, Quality
from services.dpm.http.context import jsonable
from services.dpm.operations.dpm import Dpm

from .conftest import S, cloud, elevation, pose, put_arguments

InsertedId = Callable[[str], str]


def test_products_are_found_and_described(http: TestClient, inserted_id: InsertedId) -> None:
    body = http.get("/api/v1/products", params={"type": "dem", "region": "bbox:0,0,1,1"}).json()
    (item,) = body["items"]
    assert item["id"] == inserted_id("dem")
    assert item["t1_ns"] == "0"
    assert item["box_m"][:2] == [0.0, 0.0]
    assert body["links"].keys() == {"self"}
    description = http.get(item["links"]["self"]).json()
    assert set(description["formats"]) >= {"uper", "ber", "xer", "msgpack", "tif", "npz", "png"}


def test_pages_of_a_search_are_linked(http: TestClient, inserted_id: InsertedId) -> None:
    products, url = [], "/api/v1/products?limit=1"
    while url:
        body = http.get(url).json()
        products += [item["product"] for item in body["items"]]
        url = body["links"].get("next")
    assert products == ["pose", "pointcloud", "navigation_map", "dem"]


@pytest.mark.parametrize("codec", ["uper", "ber", "xer", "msgpack"])
def test_a_payload_is_returned_in_any_codec(http: TestClient, inserted_id: InsertedId, codec: str) -> None:
    answer = http.get(f"/api/v1/products/{inserted_id('pose')}/payload", params={"format": codec})
    assert answer.status_code == 200
    assert answer.headers["cdff-encoding"] == f"application/vnd.cdff+{codec};TransformWithCovariance/1"
    assert decode("TransformWithCovariance", answer.content, codec).transform.matrix[0, 3] == 1.0


@pytest.mark.parametrize(
    ("product", "form", "magic", "media"),
    [
        ("dem", "tif", b"II*\x00", "image/tiff"),
        ("dem", "png", b"\x89PNG", "image/png"),
        ("dem", "npz", b"PK", "application/x-npz"),
        ("navigation_map", "png", b"\x89PNG", "image/png"),
        ("navigation_map", "tif", b"II*\x00", "image/tiff"),
        ("pointcloud", "ply", b"ply\n", "application/x-ply"),
        ("pointcloud", "las", b"LASF", "application/vnd.las"),
        ("pointcloud", "pcd", b"#", "application/x-pcd"),
        ("pose", "tum", b"3", "text/plain"),
    ],
)
def test_a_payload_is_returned_in_the_file_formats_of_its_type(
    http: TestClient, inserted_id: InsertedId, product: str, form: str, magic: bytes, media: str
) -> None:
    answer = http.get(f"/api/v1/products/{inserted_id(product)}/payload", params={"format": form})
    assert answer.status_code == 200, answer.text
    assert answer.content.startswith(magic)
    assert answer.headers["content-type"].startswith(media)
    assert inserted_id(product) in answer.headers["content-disposition"]


def test_a_dem_is_returned_as_infuse_map(http: TestClient, inserted_id: InsertedId) -> None:
    answer = http.get(
        f"/api/v1/products/{inserted_id('dem')}/payload", params={"format": "uper", "as": "Map"}
    )
    assert answer.headers["cdff-encoding"] == "application/vnd.cdff+uper;Map/1"
    decode("Map", answer.content, "uper")


def test_an_unsupported_format_is_refused_with_the_supported_ones(
    http: TestClient, inserted_id: InsertedId
) -> None:
    answer = http.get(f"/api/v1/products/{inserted_id('pose')}/payload", params={"format": "tif"})
    assert answer.status_code == 422
    assert "tum" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("requested_range", "first_byte", "last_byte"),
    [("bytes=0-9", 0, 9), ("bytes=5-", 5, None), ("bytes=-7", -7, None), ("bytes=3-3", 3, 3)],
)
def test_native_payloads_are_returned_in_parts(
    http: TestClient,
    dpm: Dpm,
    inserted_id: InsertedId,
    requested_range: str,
    first_byte: int,
    last_byte: int | None,
) -> None:
    whole = dpm.store.payload(inserted_id("pointcloud"))
    answer = http.get(
        f"/api/v1/products/{inserted_id('pointcloud')}/payload", headers={"Range": requested_range}
    )
    assert answer.status_code == 206
    assert answer.content == (whole[first_byte:] if last_byte is None else whole[first_byte : last_byte + 1])
    assert answer.headers["content-range"].endswith(f"/{len(whole)}")


def test_a_range_beyond_the_end_is_not_satisfiable_and_a_malformed_one_ignored(
    http: TestClient, inserted_id: InsertedId
) -> None:
    url = f"/api/v1/products/{inserted_id('pose')}/payload"
    assert http.get(url, headers={"Range": "bytes=999999-"}).status_code == 416
    for malformed in ("bytes=1-2,5-6", "lines=1-2", "bytes=9-2", "bytes=-"):
        assert http.get(url, headers={"Range": malformed}).status_code == 200


def test_a_payload_that_the_client_has_is_not_sent_again(http: TestClient, inserted_id: InsertedId) -> None:
    url = f"/api/v1/products/{inserted_id('dem')}/payload"
    etag = http.get(url).headers["etag"]
    assert http.get(url, headers={"If-None-Match": etag}).status_code == 304


@pytest.mark.parametrize("product", ["dem", "navigation_map", "pointcloud"])
def test_thumbnails_are_small_and_not_empty(http: TestClient, inserted_id: InsertedId, product: str) -> None:
    from PIL import Image

    answer = http.get(f"/api/v1/products/{inserted_id(product)}/thumbnail.png")
    with Image.open(io.BytesIO(answer.content)) as picture:
        assert max(picture.size) <= 256
        assert np.asarray(picture)[..., 3].any()
    assert (
        http.get(
            f"/api/v1/products/{inserted_id(product)}/thumbnail.png",
            headers={"If-None-Match": answer.headers["etag"]},
        ).status_code
        == 304
    )


def insertion(value: object, product: str, **fields: object) -> dict:
    """Return the arguments of the POST request that inserts a product."""
    names, payload, encoding, attachment = put_arguments(value, product, **fields)
    header = jsonable(Header.from_attachment(attachment).to_dict())
    return {
        "params": names,
        "content": payload,
        "headers": {"Content-Type": encoding, "CDFF-Header": json.dumps(header)},
    }


def test_a_product_is_inserted_once_and_other_content_is_refused(http: TestClient) -> None:
    first = http.post("/api/v1/products", **insertion(cloud(), "pointcloud"))
    repeated = http.post("/api/v1/products", **insertion(cloud(), "pointcloud"))
    assert (first.status_code, repeated.status_code) == (201, 200)
    assert http.get(first.headers["location"]).json()["product"] == "pointcloud"
    other_content = http.post(
        "/api/v1/products", **(insertion(cloud(), "pointcloud") | {"content": encode(cloud(5), "uper")})
    )
    assert other_content.status_code == 409
    assert other_content.json()["code"] == "CONFLICT"


def test_a_deleted_product_is_not_found(http: TestClient, inserted_id: InsertedId) -> None:
    url = f"/api/v1/products/{inserted_id('dem')}"
    assert http.delete(url).json() == {"id": inserted_id("dem"), "deleted": True}
    assert http.get(url).status_code == http.get(f"{url}/payload").status_code == 404


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/api/v1/products?limit=0", 422),
        ("/api/v1/products?limit=x", 422),
        ("/api/v1/products?nonsense=1", 422),
        ("/api/v1/products?region=blob:1", 422),
        ("/api/v1/products?region=bbox:0,0,nan,1", 422),
        ("/api/v1/products?cursor=%00", 422),
        ("/api/v1/products?t0=yesterday", 422),
        ("/api/v1/products/nope", 404),
        ("/api/v1/products/..%2f..%2fetc%2fpasswd", 404),
        ("/api/v1/products?region=near:nowhere,3", 404),
        ("/api/v1/maps/dem/window?region=bbox:900,900,901,901", 404),
        ("/api/v1/maps/soil/window", 404),
        ("/api/v1/maps/dem/window?resolution_m=-1", 422),
        ("/api/v1/frames/nowhere/revisions", 404),
        ("/api/v1/poses", 422),
        ("/api/v1/poses?robot=mana&t=1000&t0=1000", 422),
        ("/api/v1/poses?robot=mana&t=1000", 404),
        ("/api/v1/robots/nobody", 404),
        ("/api/v1/requests", 503),
        ("/static/../app.py", 404),
        ("/nowhere", 404),
    ],
)
def test_invalid_requests_get_problem_documents(
    http: TestClient, inserted_id: InsertedId, path: str, status: int
) -> None:
    answer = http.get(path)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["status"] == status
    assert answer.json()["detail"]


@pytest.mark.parametrize(
    "change",
    [
        {"headers": {}},
        {"params": {"robot": "../x"}},
        {"content": b"\xff" * 9},
        {"header": "[]"},
        {"header": "{"},
        {"header": '{"t0_ns": "1", "t1_ns": "2", "frame": NaN}'},
    ],
)
def test_invalid_insertions_are_refused_and_not_stored(http: TestClient, dpm: Dpm, change: dict) -> None:
    arguments = insertion(cloud(), "pointcloud")
    if "header" in change:
        arguments["headers"]["CDFF-Header"] = change["header"]
    elif "params" in change:
        arguments["params"] |= change["params"]
    else:
        arguments |= change
    answer = http.post("/api/v1/products", **arguments)
    assert answer.status_code == 422, answer.text
    assert dpm.store.statistics().count == 0


def test_a_too_large_body_is_refused_with_and_without_content_length(http: TestClient, dpm: Dpm) -> None:
    arguments = insertion(cloud(), "pointcloud")
    large = b"x" * (3 << 20)
    assert http.post("/api/v1/products", **(arguments | {"content": large})).status_code == 413
    chunks = (large[i : i + 65536] for i in range(0, len(large), 65536))
    assert http.post("/api/v1/products", **(arguments | {"content": chunks})).status_code == 413
    assert dpm.store.statistics().count == 0


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "", "localhost.evil:8080"])
def test_an_unknown_host_is_refused(http: TestClient, host: str) -> None:
    assert http.get("/api/v1/products", headers={"Host": host}).status_code == 421


@pytest.mark.parametrize("host", ["localhost:8080", "127.0.0.1", "[::1]:8080", "LOCALHOST"])
def test_known_hosts_are_answered(http: TestClient, host: str) -> None:
    assert http.get("/healthz", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:9999"},
        {"Sec-Fetch-Site": "cross-site"},
    ],
)
def test_writes_from_foreign_origins_are_refused_and_reads_are_not(
    http: TestClient, inserted_id: InsertedId, headers: dict
) -> None:
    url = f"/api/v1/products/{inserted_id('dem')}"
    assert http.delete(url, headers=headers).status_code == 403
    assert http.get(url, headers=headers).status_code == 200
    assert http.delete(url, headers={"Origin": "http://127.0.0.1:8080"}).status_code == 200


def test_a_map_window_states_its_coverage(http: TestClient, dpm: Dpm) -> None:
    dpm.writer.put(*put_arguments(elevation(0.0, 1.0), "dem", 1, resolution_m=0.1))
    answer = http.get(
        "/api/v1/maps/dem/window", params={"region": "bbox:0,0,4,2", "format": "npz", "resolution_m": "0.2"}
    )
    assert answer.headers["cdff-coverage"] == "0.5000"
    assert answer.headers["cdff-resolution-m"] == "0.2"
    assert np.load(io.BytesIO(answer.content))["mean"].shape == (10, 20)


def test_frames_are_revised_and_listed(http: TestClient) -> None:
    T = np.eye(4)
    T[0, 3] = 2.0
    url = "/api/v1/frames/mana/odom/revisions"
    revision_body = {"parent": "site", "T": T.tolist(), "expected_revision": 0}
    assert http.post(url, json=revision_body).status_code == 201
    assert http.post(url, json=revision_body).status_code == 409
    assert http.post(url, json={"parent": "site", "T": [[1]]}).status_code == 422
    assert http.post(url, json={"parent": "site", "T": (T * 2).tolist()}).status_code == 422
    (revision,) = http.get(url).json()["items"]
    assert (revision["revision"], revision["T"][0][3]) == (1, 2.0)
    assert http.get("/api/v1/frames").json()["items"][0]["frame"] == "mana/odom"


def test_poses_are_returned_as_a_series_or_interpolated_at_a_time(http: TestClient, dpm: Dpm) -> None:
    for second in range(4):
        dpm.writer.put(*put_arguments(pose(second, float(second)), "pose", second, child="mana/base"))
    series = http.get("/api/v1/poses", params={"robot": "mana", "t0": str(1 * S), "t1": str(2 * S)}).json()[
        "items"
    ]
    assert [p["stamp_ns"] for p in series] == [str(1 * S), str(2 * S)]
    (interpolated,) = http.get(
        "/api/v1/poses", params={"robot": "mana", "t": "1970-01-01T00:00:01.5Z"}
    ).json()["items"]
    assert interpolated["T"][0][3] == pytest.approx(1.5)


def test_robots_status_and_metrics(http: TestClient, inserted_id: InsertedId) -> None:
    (robot,) = http.get("/api/v1/robots").json()["items"]
    assert (robot["id"], robot["pose"]["T"][0][3]) == ("mana", 1.0)
    status = http.get("/api/v1/status").json()
    assert status["by_robot"] == {"mana": {"dem": 1, "navigation_map": 1, "pointcloud": 1, "pose": 1}}
    assert status["now_ns"] == str(100 * S)
    assert 'cdff_dpm_products{robot="mana",type="dem"} 1' in http.get("/metrics").text
    assert http.get("/readyz").text == "ready\n"


def test_the_pages_load_nothing_from_other_hosts(http: TestClient) -> None:
    for path in ("/", "/docs"):
        page = http.get(path)
        assert page.headers["content-type"].startswith("text/html")
        assert "default-src 'self'" in page.headers["content-security-policy"]
        links = re.findall(r'(?:src|href)="([^"]+)"', page.text)
        assert not any(re.match(r"/|\w+:", link) for link in links)  # relative, for a proxy with a path
        for link in links:
            if link.startswith("static/"):
                assert http.get(f"/{link}").status_code == 200


def test_every_operation_has_a_summary_and_a_description(http: TestClient) -> None:
    for verbs in http.get("/openapi.json").json()["paths"].values():
        for operation in verbs.values():
            assert operation["summary"]
            assert operation["description"]


UNUSUAL_REGIONS = [
    "bbox:0,0,1,1",
    "bbox:0,0,1",
    "polygon:0,0,1,1,1,0,0,1",
    "circle:0,0,1e308",
    "box:0,0,0,1e308,1e308,1e308",
    "near:a,1",
]
UNUSUAL_TIMES = [
    "9999999999999999999",
    "-9223372036854775000",
    "1970-01-01T00:00:00Z",
    "0001-01-01T00:00:00+23:59",
]
PARAMETERS = [
    "type",
    "robot",
    "region",
    "frame",
    "t0",
    "t1",
    "t",
    "limit",
    "cursor",
    "after",
    "order",
    "status",
    "format",
    "child",
    "resolution_m",
    "resolution_max_m",
    "max_age_s",
    "min_coverage",
]
texts = st.one_of(
    st.text(max_size=30),
    st.integers().map(str),
    st.floats().map(str),
    st.sampled_from(["dem", "mana", "site", "OK", "1e400", *UNUSUAL_REGIONS, *UNUSUAL_TIMES]),
)
paths = st.sampled_from(["/api/v1/products", "/api/v1/poses", "/api/v1/maps/dem/window"])


@pytest.mark.slow
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(path=paths, parameters=st.dictionaries(st.sampled_from(PARAMETERS), texts, max_size=4))
def test_arbitrary_parameters_never_cause_a_server_error(
    http: TestClient, inserted_id: InsertedId, path: str, parameters: dict[str, str]
) -> None:
    answer = http.get(path, params=parameters)
    assert answer.status_code < 500, answer.text
    if answer.status_code >= 400:
        assert answer.headers["content-type"] == "application/problem+json"


def test_a_nan_metric_is_null(http: TestClient, dpm: Dpm) -> None:
    quality = Quality(metrics={"residual": float("inf"), "ratio": float("nan")})
    _, header = dpm.writer.put(*put_arguments(cloud(), "pointcloud", quality=quality))
    for path in ("/api/v1/products", f"/api/v1/products/{header.id}"):
        data = http.get(path).json()
        item = data["items"][0] if "items" in data else data
        assert item["quality"]["metrics"] == {"residual": None, "ratio": None}
    assert http.get("/stac/search").status_code == 200
