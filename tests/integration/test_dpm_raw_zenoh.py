# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The Zenoh interface of the DPM, called by a program that uses only Zenoh and MessagePack."""

from __future__ import annotations

import hashlib
import queue
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import msgpack
import numpy as np
import pytest
import zenoh

from cdff_common.codecs import encode
from cdff_common.types import Pointcloud
from cdff_dev.ports import free_port

from .conftest import process_starter, wait_until

pytestmark = pytest.mark.integration

S = 1_000_000_000
ENCODING = "application/vnd.cdff+uper;Pointcloud/1"
PROFILE = "name: test\nrobots:\n- id: mana\n- id: minnie\n"
POINTS = np.random.default_rng(0).normal(0.0, 5.0, (20_000, 3))
CLOUD = encode(Pointcloud.from_points(POINTS, frame="site", stamp_ns=S), "uper")


@dataclass(frozen=True)
class ZenohReply:
    """A reply: payload and attachment, or the decoded map of a ``reply_err``."""

    payload: bytes
    attachment: dict[str, Any]
    error: dict[str, Any] | None


class RawSession:
    """A Zenoh session without the code of this project."""

    def __init__(self, endpoint: str) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{endpoint}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        self.session = zenoh.open(config)

    def query(self, key: str, parameters: str = "", **options: Any) -> ZenohReply:
        """Return the only reply to a query with the defaults of Zenoh."""
        selector = f"{key}?{parameters}" if parameters else key
        (reply,) = self.session.get(selector, timeout=20.0, **options)
        if reply.ok is None:
            return ZenohReply(b"", {}, msgpack.unpackb(reply.err.payload.to_bytes()))
        sample = reply.ok
        attachment = {} if sample.attachment is None else msgpack.unpackb(sample.attachment.to_bytes())
        return ZenohReply(sample.payload.to_bytes(), attachment, None)

    def put(
        self,
        scope: str = "mana",
        seq: int = 0,
        payload: bytes = CLOUD,
        more_parameters: str = "",
        **fields: Any,
    ) -> ZenohReply:
        """Insert the point cloud ``CLOUD``."""
        header = {
            "v": 1,
            "id": str(uuid.uuid5(uuid.NAMESPACE_URL, f"{scope}/{seq}")),
            "seq": seq,
            "t0_ns": S,
            "t1_ns": S,
            "frame": "site",
            "producer": "outsider",
            "config_hash": "c",
            "inputs": [],
            "quality": {"status": "OK", "reasons": [], "covariance_kind": "none", "metrics": {}},
        }
        return self.query(
            f"cdff/@v1/{scope}/dpm/@rpc/put",
            f"dfpc=outsider;port=cloud;product=pointcloud{more_parameters}",
            payload=payload,
            encoding=ENCODING,
            attachment=msgpack.packb(header | fields),
        )

    def count(self) -> int:
        """Return the number of products in the store."""
        products: int = msgpack.unpackb(self.query("cdff/@v1/ground/dpm/@rpc/stat").payload)["products"]
        return products


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RawSession]:
    """A session with a running router and DPM."""
    folder, endpoint = tmp_path_factory.mktemp("raw"), f"tcp/127.0.0.1:{free_port()}"
    profile = folder / "profile.yaml"
    profile.write_text(PROFILE)
    with process_starter(endpoint, folder) as start:
        start("services.router")
        start("services.dpm", "--profile", str(profile), "--http", f"127.0.0.1:{free_port()}")
        results: list[RawSession] = []

        def can_connect() -> bool:
            try:
                results.append(RawSession(endpoint))
            except zenoh.ZError:
                return False
            return True

        wait_until(can_connect, 30, "the router")
        zenoh_session = results[0].session
        wait_until(
            lambda: len(list(zenoh_session.liveliness().get("cdff/@v1/*/@alive/dpm"))) == 3, 60, "the DPM"
        )
        yield results[0]
        zenoh_session.close()


@pytest.mark.req("CDFF-SUP-165")
def test_a_payload_retrieved_in_chunks_is_complete(session: RawSession) -> None:
    stored = msgpack.unpackb(session.put(seq=1).payload)
    assert stored["result"] == "inserted"
    key = f"cdff/@v1/mana/dpm/product/{stored['id']}"
    chunks, offset, chunk_bytes = [], 0, 100_000
    while True:
        reply = session.query(key, f"offset={offset};len={chunk_bytes}")
        assert reply.error is None
        assert (reply.attachment["offset"], reply.attachment["len"]) == (offset, len(reply.payload))
        chunks.append(reply.payload)
        offset += len(reply.payload)
        if offset == reply.attachment["size"]:
            break
    assert len(chunks) == -(-len(CLOUD) // chunk_bytes)
    assert b"".join(chunks) == CLOUD
    assert reply.attachment["sha256"] == hashlib.sha256(CLOUD).hexdigest()
    assert session.query(key).payload == CLOUD
    assert session.query(key, f"offset={len(CLOUD) - 7}").payload == CLOUD[-7:]
    assert session.query(key.replace("/mana/", "/ground/")).payload == CLOUD


@pytest.mark.parametrize(
    ("parameters", "code"),
    [
        ("?offset=999999999", "INVALID_ARGUMENT"),
        ("?offset=-1", "INVALID_ARGUMENT"),
        ("?len=0", "INVALID_ARGUMENT"),
        ("?offset=a", "INVALID_ARGUMENT"),
        ("?nonsense=1", "INVALID_ARGUMENT"),
        ("?offset=1;offset=2", "INVALID_ARGUMENT"),
    ],
)
def test_invalid_parameters_of_a_payload_query_are_refused(
    session: RawSession, parameters: str, code: str
) -> None:
    product = msgpack.unpackb(session.put(seq=1).payload)["id"]
    reply = session.query(f"cdff/@v1/mana/dpm/product/{product}{parameters}")
    assert reply.error is not None
    assert reply.error["code"] == code
    assert reply.error["detail"]


def test_an_unknown_product_is_not_found(session: RawSession) -> None:
    for name in (str(uuid.uuid4()), "passwd", "..."):
        reply = session.query(f"cdff/@v1/mana/dpm/product/{name}")
        assert reply.error is not None
        assert reply.error["code"] == "NOT_FOUND"


@pytest.mark.req("CDFF-SUP-165")
def test_events_are_sent_to_subscribers(session: RawSession) -> None:
    events: queue.SimpleQueue[tuple[str, dict[str, Any]]] = queue.SimpleQueue()
    subscriber = session.session.declare_subscriber(
        "cdff/@v1/*/event/*", lambda s: events.put((str(s.key_expr), msgpack.unpackb(s.payload.to_bytes())))
    )
    product = msgpack.unpackb(session.put(seq=2).payload)["id"]
    session.query(
        f"cdff/@v1/mana/dpm/@rpc/update?id={product};if_match=0", payload=msgpack.packb({"tags": ["seen"]})
    )
    revision = {"frame": "mana/odom", "parent": "site", "T": np.eye(4).tolist()}
    session.query("cdff/@v1/mana/dpm/@rpc/frames", payload=msgpack.packb(revision))
    session.query(f"cdff/@v1/mana/dpm/@rpc/delete?id={product}")
    received = [events.get(timeout=20) for _ in range(4)]
    subscriber.undeclare()
    assert [key.rsplit("/", 1)[1] for key, _ in received] == ["inserted", "updated", "reanchored", "deleted"]
    assert all(key.startswith("cdff/@v1/mana/event/") for key, _ in received)
    assert [body.get("id", body.get("frame")) for _, body in received] == [
        product,
        product,
        "mana/odom",
        product,
    ]
    assert all(body["by"] == "zenoh/robot/mana" for _, body in received)
    ordinals = [body["ordinal"] for _, body in received]
    assert ordinals == sorted(ordinals)


INVALID: dict[str, dict[str, Any]] = {
    "a NaN in the box": {"box_m": [float("nan"), 0, 0, 1, 1, 1]},
    "a self-crossing footprint": {
        "box_m": [0, 0, 0, 9, 9, 9],
        "footprint_m": [[0, 0], [4, 4], [4, 0], [0, 4]],
    },
    "an unknown frame": {"frame": "elsewhere"},
    "a time after the year 2100": {"t1_ns": 5_000_000_000 * S},
    "an id that is a path": {"id": "../../etc/passwd"},
    "another digest": {"sha256": "0" * 64},
    "random bytes": {"payload": b"\xff" * 5000},
    "a truncated payload": {"payload": CLOUD[:1000]},
    "another type": {"more_parameters": ";product=dem"},
    "an unknown parameter": {"more_parameters": ";nonsense=1"},
}


@pytest.mark.parametrize("fault", INVALID)
def test_invalid_input_is_refused_with_a_reason_and_not_stored(session: RawSession, fault: str) -> None:
    before = session.count()
    reply = session.put(seq=50, **INVALID[fault])
    assert reply.error is not None
    assert (reply.error["code"], reply.error["retriable"]) == ("INVALID_ARGUMENT", False)
    assert reply.error["detail"]
    assert session.count() == before


def test_a_product_ahead_of_the_clock_is_not_stored_and_may_be_sent_again(session: RawSession) -> None:
    before = session.count()
    reply = session.put(seq=50, t1_ns=4_000_000_000 * S)
    assert reply.error is not None
    assert (reply.error["code"], reply.error["retriable"]) == ("UNAVAILABLE", True)
    assert session.count() == before


def test_a_robot_key_writes_only_products_of_that_robot(session: RawSession) -> None:
    of_mana = msgpack.unpackb(session.put(seq=3).payload)["id"]
    other = session.put("minnie", seq=4, more_parameters=";robot=mana")
    assert other.error is not None
    assert other.error["code"] == "INVALID_ARGUMENT"
    for verb, options in (("delete", {}), ("update", {"payload": msgpack.packb({"pinned": True})})):
        condition = ";if_match=0" if verb == "update" else ""
        reply = session.query(f"cdff/@v1/minnie/dpm/@rpc/{verb}?id={of_mana}{condition}", **options)
        assert reply.error is not None
        assert reply.error["code"] == "DENIED"
    revision = {"frame": "mana/odom", "parent": "site", "T": np.eye(4).tolist()}
    reply = session.query("cdff/@v1/minnie/dpm/@rpc/frames", payload=msgpack.packb(revision))
    assert reply.error is not None
    assert reply.error["code"] == "DENIED"
    for verb, body in (
        ("bodies", {"name": "rock", "kind": "asteroid"}),
        ("place?frame=site", {"body": "mars", "lon_deg": 0.0, "lat_deg": 0.0}),
    ):
        reply = session.query(f"cdff/@v1/minnie/dpm/@rpc/{verb}", payload=msgpack.packb(body))
        assert reply.error is not None
        assert reply.error["code"] == "DENIED"
    refused = msgpack.unpackb(
        session.query("cdff/@v1/ground/dpm/@rpc/history?kind=refused;scope=minnie").payload
    )
    assert {item["by"] for item in refused["items"]} == {"zenoh/robot/minnie"}
    assert "DENIED" in {item["status"] for item in refused["items"]}
    assert session.query(f"cdff/@v1/ground/dpm/@rpc/delete?id={of_mana}").error is None
