# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Invalid input over HTTP and Zenoh is refused with a reason, and without storing or large allocations."""

from __future__ import annotations

import contextlib
import json
import math
import struct
from collections.abc import Callable, Iterator
from typing import Any

import msgpack
import numpy as np
import psutil
import pytest
from fastapi.testclient import TestClient

from cdff_common.bus import Request
from cdff_common.clock import ManualClock
from cdff_common.codecs import encode
from cdff_common.errors import CdffError, InputError, rpc_code
from cdff_common.interfaces.product import Header
from cdff_common.types import Pointcloud
from dpm_store import open_store
from services.dpm.bus import service
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.operations.checks import MAX_SKEW_S
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

from .conftest import S, cloud, elevation, navigation, put_arguments

Change = Callable[[dict[str, Any]], dict[str, Any]]
NAN = math.nan
BOX = [-9.0, -9.0, -9.0, 9.0, 9.0, 9.0]
BEYOND_SKEW_NS = (100 + int(MAX_SKEW_S) + 1) * S
#: Change of a valid header that makes it invalid, by description.
HEADERS: dict[str, Change] = {
    "no id": lambda h: {k: v for k, v in h.items() if k != "id"},
    "an id that is a path": lambda h: h | {"id": "../../etc/passwd"},
    "an id that is a number": lambda h: h | {"id": 7},
    "an id with a NUL": lambda h: h | {"id": "\0" * 36},
    "a NaN in the box": lambda h: h | {"box_m": [NAN, *BOX[1:]]},
    "an infinite box": lambda h: h | {"box_m": [*BOX[:5], math.inf]},
    "a box that ends beyond the solar system": lambda h: h | {"box_m": [-1e300, *BOX[1:]]},
    "a box with exchanged corners": lambda h: h | {"box_m": BOX[::-1]},
    "a box elsewhere than the content": lambda h: h | {"box_m": [500.0, 500.0, 500.0, 501.0, 501.0, 501.0]},
    "a box that contains a part of the content": lambda h: h | {"box_m": [*BOX[:5], 0.0]},
    "a box of five numbers": lambda h: h | {"box_m": BOX[:5]},
    "a box that is text": lambda h: h | {"box_m": "abcdef"},
    "a self-crossing footprint": lambda h: (
        h | {"box_m": BOX, "footprint_m": [[0, 0], [4, 4], [4, 0], [0, 4]]}
    ),
    "a footprint outside the box": lambda h: h | {"box_m": BOX, "footprint_m": [[0, 0], [40, 0], [0, 40]]},
    "a NaN in the footprint": lambda h: h | {"box_m": BOX, "footprint_m": [[0, 0], [4, NAN], [0, 4]]},
    "an unknown frame": lambda h: h | {"frame": "elsewhere"},
    "a frame of an unknown robot": lambda h: h | {"frame": "ghost/odom"},
    "a frame that is a path": lambda h: h | {"frame": "../site"},
    "a frame that is a list": lambda h: h | {"frame": ["site"]},
    "a time beyond all columns": lambda h: h | {"t1_ns": 2**63 // 1000 * 1000},
    "a time before the mission": lambda h: h | {"t0_ns": -S},
    "an unknown field": lambda h: h | {"boxm": BOX},
    "an unknown field of the quality": lambda h: h | {"quality": h["quality"] | {"reason": ["few_points"]}},
    "a time of half a microsecond": lambda h: h | {"t0_ns": 500},
    "an end before the start": lambda h: h | {"t0_ns": 2 * S, "t1_ns": S},
    "an infinite counter": lambda h: h | {"seq": math.inf},
    "a negative counter": lambda h: h | {"seq": -1},
    "a counter beyond all columns": lambda h: h | {"seq": 2**63},
    "inputs that are paths": lambda h: h | {"inputs": ["../../etc/shadow"]},
    "too many inputs": lambda h: h | {"inputs": ["a"] * 10_001},
    "inputs that are a number": lambda h: h | {"inputs": 3},
    "inputs that are a text": lambda h: h | {"inputs": "abc"},
    "a too long producer": lambda h: h | {"producer": "x" * 10_000},
    "a producer with control characters": lambda h: h | {"producer": "a\r\nSet-Cookie: b"},
    "a cell size of zero": lambda h: h | {"resolution_m": 0.0},
    "a NaN cell size": lambda h: h | {"resolution_m": NAN},
    "a quality that is a list": lambda h: h | {"quality": [1]},
    "an unknown status": lambda h: h | {"quality": {"status": "SUPERB"}},
    "too many metrics": lambda h: (
        h | {"quality": h["quality"] | {"metrics": {f"m{i}": 1.0 for i in range(300)}}}
    ),
    "another wire version": lambda h: h | {"v": 99},
    "another digest": lambda h: h | {"sha256": "0" * 64},
    "FAILED with a payload": lambda h: h | {"quality": h["quality"] | {"status": "FAILED"}},
}


def cloud_declaring(points: int) -> bytes:
    """Return a truncated UPER cloud whose header declares ``points`` points."""
    return encode(cloud(3), "uper")[:40] + struct.pack(">I", points)


NAMES, PAYLOAD, ENCODING, ATTACHMENT = put_arguments(cloud(), "pointcloud")
PAYLOADS: dict[str, tuple[dict[str, str], bytes, str]] = {
    "a cloud put as a map": (NAMES | {"product": "dem"}, PAYLOAD, ENCODING),
    "a cloud encoded as a pose": (NAMES, PAYLOAD, ENCODING.replace("Pointcloud", "TransformWithCovariance")),
    "an unknown type": (NAMES, PAYLOAD, ENCODING.replace("Pointcloud", "Ghost")),
    "an unknown codec": (NAMES, PAYLOAD, ENCODING.replace("uper", "zip")),
    "no encoding": (NAMES, PAYLOAD, ""),
    "a too long encoding": (NAMES, PAYLOAD, ENCODING + "x" * 5000),
    "an unknown product": (NAMES | {"product": "cake"}, PAYLOAD, ENCODING),
    "an empty payload": (NAMES, b"", ENCODING),
    "half of the payload": (NAMES, PAYLOAD[: len(PAYLOAD) // 2], ENCODING),
    "noise": (NAMES, b"\xff" * 4096, ENCODING),
    "4 294 967 295 declared points": (NAMES, cloud_declaring(2**32 - 1), ENCODING),
    "a zip archive": (NAMES, b"PK\x03\x04" + b"\0" * 2000, ENCODING),
    "more bytes than the limit": (NAMES, b"\0" * (1 << 20) + b"1", ENCODING),
    "a port that is a path": (NAMES | {"port": "../x"}, PAYLOAD, ENCODING),
    "a too long dfpc": (NAMES | {"dfpc": "x" * 65}, PAYLOAD, ENCODING),
}
#: Largest memory that the refusal of an input may allocate.
MAX_ALLOCATION_BYTES = 64 << 20


@pytest.fixture(scope="module")
def dpm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dpm]:
    """One DPM for all tests, because no test changes it."""
    with open_store(f"sqlite:///{tmp_path_factory.mktemp('bad')}", ManualClock(100 * S)) as store:
        yield Dpm(store, max_payload_bytes=1 << 20)


@pytest.fixture(scope="module")
def http(dpm: Dpm) -> TestClient:
    """A client of the HTTP interface of the DPM."""
    app = create_app(Context(dpm, Settings(dpm.store.directory, max_body_bytes=2 << 20)))
    return TestClient(app, base_url="http://127.0.0.1:8080", raise_server_exceptions=False)


@contextlib.contextmanager
def unchanged_store(dpm: Dpm) -> Iterator[None]:
    """Check that nothing is stored, and that no memory is allocated for declared sizes."""
    process = psutil.Process()

    def state() -> tuple[Any, ...]:
        event_kinds = [e.kind for e in dpm.store.events.since() if e.kind != "refused"]
        blobs = sorted(p.name for p in (dpm.store.directory / "blobs").rglob("*") if p.is_file())
        return dpm.store.statistics().count, event_kinds, blobs, dpm.store.frame_names()

    state_before, resident_bytes = state(), process.memory_info().rss
    yield
    assert state() == state_before
    assert process.memory_info().rss - resident_bytes < MAX_ALLOCATION_BYTES


def over_http(
    http: TestClient, names: dict[str, str], payload: bytes, encoding: str, header: dict[str, Any]
) -> None:
    headers = {"Content-Type": encoding, "CDFF-Header": json.dumps(json_fields(header))}
    answer = http.post("/api/v1/products", params=names, content=payload, headers=headers)
    assert 400 <= answer.status_code < 500, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["detail"]


def json_fields(header: dict[str, Any]) -> dict[str, Any]:
    """Return a header with times as decimal strings; NaN and infinity stay, although they are no JSON."""
    return {k: str(v) if k.endswith("_ns") and isinstance(v, int) else v for k, v in header.items()}


def over_zenoh(dpm: Dpm, names: dict[str, str], payload: bytes, encoding: str, attachment: bytes) -> None:
    parameters = {k: v for k, v in names.items() if k != "robot"}
    request = Request("cdff/@v1/mana/dpm/@rpc/put", parameters, payload, encoding, attachment)
    with pytest.raises(CdffError) as refused:
        service.put(dpm, request)
    assert rpc_code(refused.value)[0] == "INVALID_ARGUMENT"
    assert str(refused.value)


@pytest.mark.req("CDFF-SUP-162")
@pytest.mark.parametrize("case", HEADERS)
def test_a_bad_header_is_refused(http: TestClient, dpm: Dpm, case: str) -> None:
    header = HEADERS[case](Header.from_attachment(ATTACHMENT).to_dict())
    with unchanged_store(dpm):
        over_http(http, NAMES, PAYLOAD, ENCODING, header)
        try:
            attachment = msgpack.packb(header)
        except OverflowError:  # MessagePack cannot represent the integer
            return
        over_zenoh(dpm, NAMES, PAYLOAD, ENCODING, attachment)


@pytest.mark.req("CDFF-SUP-162")
@pytest.mark.parametrize("case", PAYLOADS)
def test_a_bad_payload_is_refused(http: TestClient, dpm: Dpm, case: str) -> None:
    names, payload, encoding = PAYLOADS[case]
    with unchanged_store(dpm):
        over_http(http, names, payload, encoding, Header.from_attachment(ATTACHMENT).to_dict())
        over_zenoh(dpm, names, payload, encoding, ATTACHMENT)


INVALID_ATTACHMENTS = {
    "empty": b"",
    "reserved": b"\xc1",
    "declares 4 G items": b"\xdd\xff\xff\xff\xff",
    "nested": b"\x91" * 5000,
    "a list": msgpack.packb([1, 2]),
    "no fields": msgpack.packb({"v": 1}),
    "2 MB": b"\0" * (2 << 20),
}
INVALID_BATCHES = {
    "empty": b"",
    "nested": b"\x91" * 5000,
    "declares 4 G products": b"\xdd\xff\xff\xff\xff",
    "reserved": b"\xc1",
    "a map": msgpack.packb({}),
    "half a product": msgpack.packb([{"robot": "mana"}]),
    "a number": msgpack.packb([7]),
}


@pytest.mark.parametrize("attachment", INVALID_ATTACHMENTS.values(), ids=INVALID_ATTACHMENTS.keys())
def test_an_attachment_without_header_is_refused(dpm: Dpm, attachment: bytes) -> None:
    with unchanged_store(dpm):
        over_zenoh(dpm, NAMES, PAYLOAD, ENCODING, attachment)


@pytest.mark.parametrize("body", INVALID_BATCHES.values(), ids=INVALID_BATCHES.keys())
def test_a_bad_batch_is_refused(http: TestClient, dpm: Dpm, body: bytes) -> None:
    with unchanged_store(dpm):
        answer = http.post("/api/v1/products/batch", content=body)
        assert answer.status_code == 422, answer.text
        if body:
            with pytest.raises(CdffError):
                service.put_all(dpm, Request("cdff/@v1/ground/dpm/@rpc/put_all", {}, body, "", b""))


def test_one_invalid_product_rejects_the_whole_batch(http: TestClient, dpm: Dpm) -> None:
    def item(value: Any, product: str, seq: int, **fields: Any) -> dict[str, Any]:
        names, payload, encoding, attachment = put_arguments(value, product, seq, **fields)
        return {**names, "payload": payload, "encoding": encoding, "attachment": attachment}

    valid, in_future = item(elevation(0.0), "dem", 1), item(elevation(0.0), "dem", 2, t1_ns=BEYOND_SKEW_NS)
    with unchanged_store(dpm):
        answer = http.post("/api/v1/products/batch", content=msgpack.packb([valid, in_future]))
        assert (answer.status_code, answer.json()["code"]) == (503, "UNAVAILABLE")  # it may be sent again
        assert "mission clock" in answer.json()["detail"]


def test_a_capture_may_end_slightly_in_the_future(dpm: Dpm) -> None:
    _, header = dpm.writer.put(*put_arguments(cloud(), "pointcloud", 1, t1_ns=(100 + int(MAX_SKEW_S)) * S))
    assert dpm.store.get(header.id).header.t1_ns == (100 + int(MAX_SKEW_S)) * S


IDS = [
    "..",
    "../../etc/passwd",
    "..%2f..%2fetc%2fpasswd",
    "%00",
    "%2e%2e",
    "a" * 5000,
    "%5c..%5c",
    "'; drop table products",
]


@pytest.mark.parametrize("product_id", IDS)
@pytest.mark.parametrize("suffix", ["", "/payload", "/thumbnail.png", "/provenance", "/revisions"])
def test_an_id_is_never_a_path(http: TestClient, dpm: Dpm, product_id: str, suffix: str) -> None:
    with unchanged_store(dpm):
        answer = http.get(f"/api/v1/products/{product_id}{suffix}")
        assert answer.status_code in (404, 405, 422), answer.text
        assert b"root:" not in answer.content


@pytest.mark.parametrize("product_id", ["..", "../../etc/passwd", "\0", "a" * 5000])
def test_an_id_is_never_a_path_over_zenoh(dpm: Dpm, product_id: str) -> None:
    for handler, verb in (
        (service.get, "get"),
        (service.delete, "delete"),
        (service.provenance, "provenance"),
    ):
        with unchanged_store(dpm), pytest.raises(CdffError):
            handler(dpm, Request(f"cdff/@v1/ground/dpm/@rpc/{verb}", {"id": product_id}, b"", "", b""))
    with pytest.raises(CdffError):
        service.payload(dpm, Request(f"cdff/@v1/ground/dpm/product/{product_id}", {}, b"", "", b""))


FRAMES: dict[str, dict[str, Any]] = {
    "a matrix of text": {"parent": "site", "T": [["a"] * 4] * 4},
    "no rotation": {"parent": "site", "T": [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]},
    "a NaN": {"parent": "site", "T": [[1, 0, 0, NAN], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
    "a position beyond the solar system": {
        "parent": "site",
        "T": [[1, 0, 0, 1e300], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    },
    "a covariance beyond the solar system": {
        "parent": "site",
        "T": np.eye(4).tolist(),
        "covariance": (np.eye(6) * 1e300).tolist(),
    },
    "a path as parent": {"parent": "../site", "T": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
    "itself as parent": {
        "parent": "mana/odom",
        "T": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    },
    "times that are words": {
        "parent": "site",
        "T": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        "valid_from_ns": "soon",
    },
    "a revision that is a word": {
        "parent": "site",
        "T": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        "expected_revision": "x",
    },
}


@pytest.mark.parametrize("case", FRAMES)
def test_a_bad_frame_is_refused(http: TestClient, dpm: Dpm, case: str) -> None:
    body = FRAMES[case]
    with unchanged_store(dpm):
        text = json.dumps(body)
        answer = http.post(
            "/api/v1/frames/mana/odom/revisions", content=text, headers={"Content-Type": "application/json"}
        )
        assert answer.status_code == 422, answer.text
        packed = msgpack.packb({"frame": "mana/odom", **body})
        with pytest.raises(CdffError):
            service.frames(
                dpm, Request("cdff/@v1/ground/dpm/@rpc/frames", {}, packed, "application/msgpack", b"")
            )
    assert dpm.store.frames.current() == ()


def test_deeply_nested_json_is_refused(http: TestClient, dpm: Dpm) -> None:
    with unchanged_store(dpm):
        for path in ("/api/v1/frames/a/revisions", "/stac/search", "/api/v1/requests"):
            nested = "[" * 100_000 + "]" * 100_000
            answer = http.post(path, content=nested, headers={"Content-Type": "application/json"})
            assert answer.status_code in (400, 422), answer.text


CROSSING = "polygon:0,0,4,4,4,0,0,4"


@pytest.mark.parametrize(
    ("path", "status"),
    [
        (f"/api/v1/products?region={CROSSING}", 422),
        (f"/api/v1/maps/dem/window?region={CROSSING}", 422),
        ("/api/v1/products?region=bbox:nan,0,1,1", 422),
        ("/api/v1/products?region=bbox:0,0,1,1&frame=nowhere", 404),
        ("/api/v1/products?region=" + "polygon:" + "1,2," * 5000 + "1,2", 422),
        ('/stac/search?intersects={"type":"Polygon","coordinates":[[[0,0],[4,4],[4,0],[0,4],[0,0]]]}', 400),
        ('/stac/search?intersects={"type":"Polygon","coordinates":[[[0,0],[4,"a"]]]}', 400),
        ("/stac/search?bbox=nan,0,1,1", 400),
        ("/stac/search?bbox=1,2", 400),
        ("/stac/search?bbox=1,2,3,4,5,6,7,8", 400),
        ("/stac/search?ids=" + "a" * 65, 400),
        ("/stac/search?collections=" + "a" * 65, 400),
    ],
)
def test_an_invalid_region_of_a_search_is_refused(http: TestClient, dpm: Dpm, path: str, status: int) -> None:
    with unchanged_store(dpm):
        answer = http.get(path)
        assert answer.status_code == status, answer.text
        assert answer.json()["detail"]


def test_a_box_may_be_larger_than_the_content_or_smaller_by_rounding(dpm: Dpm) -> None:
    x0, *others = cloud().extent_m()
    dpm.writer.put(*put_arguments(cloud(), "pointcloud", 1, box_m=(x0 + 5e-4, *others)))
    dpm.writer.put(*put_arguments(cloud(), "pointcloud", 2, box_m=tuple(BOX)))
    with pytest.raises(
        InputError, match=r"box_m=\[.*\] m does not contain the content, which lies in \[.*\] m"
    ):
        dpm.writer.put(*put_arguments(cloud(), "pointcloud", 3, box_m=(x0 + 2e-3, *others)))


def test_a_2d_map_may_have_a_box_with_heights(dpm: Dpm) -> None:
    dpm.writer.put(*put_arguments(navigation(), "navigation_map", 1, box_m=(0.0, 0.0, 3.0, 1.0, 1.0, 4.0)))


def test_a_cloud_without_a_finite_point_is_refused_and_an_empty_one_is_not(dpm: Dpm) -> None:
    all_nan, empty = (Pointcloud.from_points(np.full((n, 3), NAN), frame="site", stamp_ns=S) for n in (4, 0))
    with pytest.raises(InputError, match="none of 4 points is finite"):
        dpm.writer.put(*put_arguments(all_nan, "pointcloud", 11))
    dpm.writer.put(*put_arguments(empty, "pointcloud", 12))
