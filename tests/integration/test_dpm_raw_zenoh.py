# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The DPM as contract §5 has it, spoken to by a program that knows Zenoh and MessagePack and nothing of ours."""

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
class Said:
    """What came back: a reply, or the map of a ``reply_err``."""

    payload: bytes
    attachment: dict[str, Any]
    error: dict[str, Any] | None


class Outsider:
    """A raw Zenoh session."""

    def __init__(self, endpoint: str) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{endpoint}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        self.session = zenoh.open(config)

    def ask(self, key: str, parameters: str = "", **given: Any) -> Said:
        """The one answer to a query, with Zenoh's own defaults."""
        selector = f"{key}?{parameters}" if parameters else key
        (reply,) = self.session.get(selector, timeout=20.0, **given)
        if reply.ok is None:
            return Said(b"", {}, msgpack.unpackb(reply.err.payload.to_bytes()))
        sample = reply.ok
        attached = {} if sample.attachment is None else msgpack.unpackb(sample.attachment.to_bytes())
        return Said(sample.payload.to_bytes(), attached, None)

    def put(self, scope: str = "mana", seq: int = 0, payload: bytes = CLOUD, more: str = "", **fields: Any) -> Said:
        """Insert the cloud."""
        header = {
            "v": 1, "id": str(uuid.uuid5(uuid.NAMESPACE_URL, f"{scope}/{seq}")), "seq": seq, "t0_ns": S, "t1_ns": S,
            "frame": "site", "producer": "outsider", "config_hash": "c", "inputs": [],
            "quality": {"status": "OK", "reasons": [], "covariance_kind": "none", "metrics": {}},
        }  # fmt: skip
        return self.ask(
            f"cdff/@v1/{scope}/dpm/@rpc/put", f"dfpc=outsider;port=cloud;product=pointcloud{more}",
            payload=payload, encoding=ENCODING, attachment=msgpack.packb(header | fields),
        )  # fmt: skip

    def count(self) -> int:
        """Products in the store."""
        products: int = msgpack.unpackb(self.ask("cdff/@v1/ground/dpm/@rpc/stat").payload)["products"]
        return products


@pytest.fixture(scope="module")
def outsider(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Outsider]:
    """A session beside a router and a DPM."""
    folder, endpoint = tmp_path_factory.mktemp("raw"), f"tcp/127.0.0.1:{free_port()}"
    profile = folder / "profile.yaml"
    profile.write_text(PROFILE)
    with process_starter(endpoint, folder) as start:
        start("services.router")
        start("services.dpm", "--profile", str(profile), "--http", f"127.0.0.1:{free_port()}")
        made: list[Outsider] = []

        def connected() -> bool:
            try:
                made.append(Outsider(endpoint))
            except zenoh.ZError:
                return False
            return True

        wait_until(connected, 30, "the router")
        session = made[0].session
        wait_until(lambda: len(list(session.liveliness().get("cdff/@v1/*/@alive/dpm"))) == 3, 60, "the DPM")
        yield made[0]
        session.close()


@pytest.mark.req("CDFF-SUP-165")
def test_a_payload_is_pulled_in_parts_and_is_whole(outsider: Outsider) -> None:
    stored = msgpack.unpackb(outsider.put(seq=1).payload)
    assert stored["result"] == "inserted"
    key = f"cdff/@v1/mana/dpm/product/{stored['id']}"
    parts, offset, part = [], 0, 100_000
    while True:
        said = outsider.ask(key, f"offset={offset};len={part}")
        assert said.error is None
        assert (said.attachment["offset"], said.attachment["len"]) == (offset, len(said.payload))
        parts.append(said.payload)
        offset += len(said.payload)
        if offset == said.attachment["size"]:
            break
    assert len(parts) == -(-len(CLOUD) // part)
    assert b"".join(parts) == CLOUD
    assert said.attachment["sha256"] == hashlib.sha256(CLOUD).hexdigest()
    assert outsider.ask(key).payload == CLOUD
    assert outsider.ask(key, f"offset={len(CLOUD) - 7}").payload == CLOUD[-7:]
    assert outsider.ask(key.replace("/mana/", "/ground/")).payload == CLOUD


@pytest.mark.parametrize(
    ("what", "code"),
    [
        ("?offset=999999999", "INVALID_ARGUMENT"),
        ("?offset=-1", "INVALID_ARGUMENT"),
        ("?len=0", "INVALID_ARGUMENT"),
        ("?offset=a", "INVALID_ARGUMENT"),
        ("?nonsense=1", "INVALID_ARGUMENT"),
        ("?offset=1;offset=2", "INVALID_ARGUMENT"),
    ],
)
def test_a_part_that_there_is_not_is_refused(outsider: Outsider, what: str, code: str) -> None:
    made = msgpack.unpackb(outsider.put(seq=1).payload)["id"]
    said = outsider.ask(f"cdff/@v1/mana/dpm/product/{made}{what}")
    assert said.error is not None
    assert said.error["code"] == code
    assert said.error["detail"]


def test_an_unknown_product_is_not_found(outsider: Outsider) -> None:
    for name in (str(uuid.uuid4()), "passwd", "..."):
        said = outsider.ask(f"cdff/@v1/mana/dpm/product/{name}")
        assert said.error is not None
        assert said.error["code"] == "NOT_FOUND"


@pytest.mark.req("CDFF-SUP-165")
def test_events_are_told_to_who_subscribes(outsider: Outsider) -> None:
    heard: queue.SimpleQueue[tuple[str, dict[str, Any]]] = queue.SimpleQueue()
    subscriber = outsider.session.declare_subscriber(
        "cdff/@v1/*/event/*", lambda s: heard.put((str(s.key_expr), msgpack.unpackb(s.payload.to_bytes())))
    )
    made = msgpack.unpackb(outsider.put(seq=2).payload)["id"]
    outsider.ask(f"cdff/@v1/mana/dpm/@rpc/update?id={made};if_match=0", payload=msgpack.packb({"tags": ["seen"]}))
    revision = {"frame": "mana/odom", "parent": "site", "T": np.eye(4).tolist()}
    outsider.ask("cdff/@v1/mana/dpm/@rpc/frames", payload=msgpack.packb(revision))
    outsider.ask(f"cdff/@v1/mana/dpm/@rpc/delete?id={made}")
    told = [heard.get(timeout=20) for _ in range(4)]
    subscriber.undeclare()
    assert [key.rsplit("/", 1)[1] for key, _ in told] == ["inserted", "updated", "reanchored", "deleted"]
    assert all(key.startswith("cdff/@v1/mana/event/") for key, _ in told)
    assert [body.get("id", body.get("frame")) for _, body in told] == [made, made, "mana/odom", made]
    assert all(body["by"] == "zenoh/robot/mana" for _, body in told)
    ordinals = [body["ordinal"] for _, body in told]
    assert ordinals == sorted(ordinals)


BAD: dict[str, dict[str, Any]] = {
    "a NaN in the box": {"box_m": [float("nan"), 0, 0, 1, 1, 1]},
    "a self-crossing footprint": {"box_m": [0, 0, 0, 9, 9, 9], "footprint_m": [[0, 0], [4, 4], [4, 0], [0, 4]]},
    "a frame that nothing is known of": {"frame": "elsewhere"},
    "a time in the future": {"t1_ns": 4_000_000_000 * S},
    "an id that is a path": {"id": "../../etc/passwd"},
    "another digest": {"sha256": "0" * 64},
    "noise": {"payload": b"\xff" * 5000},
    "half of it": {"payload": CLOUD[:1000]},
    "another type": {"more": ";product=dem"},
    "an unknown parameter": {"more": ";nonsense=1"},
}


@pytest.mark.parametrize("what", BAD)
def test_bad_input_is_refused_with_a_reason_and_nothing_is_stored(outsider: Outsider, what: str) -> None:
    before = outsider.count()
    said = outsider.put(seq=50, **BAD[what])
    assert said.error is not None
    assert (said.error["code"], said.error["retriable"]) == ("INVALID_ARGUMENT", False)
    assert said.error["detail"]
    assert outsider.count() == before


def test_a_robots_keys_write_only_what_is_the_robots(outsider: Outsider) -> None:
    of_mana = msgpack.unpackb(outsider.put(seq=3).payload)["id"]
    other = outsider.put("minnie", seq=4, more=";robot=mana")
    assert other.error is not None
    assert other.error["code"] == "INVALID_ARGUMENT"
    for verb, given in (("delete", {}), ("update", {"payload": msgpack.packb({"pinned": True})})):
        more = ";if_match=0" if verb == "update" else ""
        said = outsider.ask(f"cdff/@v1/minnie/dpm/@rpc/{verb}?id={of_mana}{more}", **given)
        assert said.error is not None
        assert said.error["code"] == "DENIED"
    revision = {"frame": "mana/odom", "parent": "site", "T": np.eye(4).tolist()}
    said = outsider.ask("cdff/@v1/minnie/dpm/@rpc/frames", payload=msgpack.packb(revision))
    assert said.error is not None
    assert said.error["code"] == "DENIED"
    for verb, given in (("bodies", {"name": "rock", "kind": "asteroid"}), ("place?frame=site", {"body": "mars"})):
        said = outsider.ask(f"cdff/@v1/minnie/dpm/@rpc/{verb}", payload=msgpack.packb(given))
        assert said.error is not None
        assert said.error["code"] == "DENIED"
    refused = msgpack.unpackb(outsider.ask("cdff/@v1/ground/dpm/@rpc/history?kind=refused;scope=minnie").payload)
    assert {item["by"] for item in refused["items"]} == {"zenoh/robot/minnie"}
    assert "DENIED" in {item["status"] for item in refused["items"]}
    assert outsider.ask(f"cdff/@v1/ground/dpm/@rpc/delete?id={of_mana}").error is None
