# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replies of the orchestrator: their metadata, and exactly one final reply in time to each request."""

from __future__ import annotations

import json
import threading
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zenoh

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from cdff_common.clock import wall_ns
from cdff_common.codecs import decode
from cdff_common.errors import DeadlineError, InputError, ProductNotFoundError, UnavailableError
from cdff_common.geometry import UncertainTransform
from cdff_common.types import TransformWithCovariance
from cdff_dev.ports import free_port
from tests.integration.conftest import process_starter
from tests.integration.conftest import wait_until as eventually
from tests.support.orchestrated_products import NOW_NS, T_SITE_BASE, patch, put

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "orchestrator.yaml")
REQUEST = keys.orchestrator_rpc("mana", "request")
REGION = "bbox:0,0,2,2"


@pytest.fixture(scope="module")
def endpoint_of_answers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A router, a DPM with a patch and poses, an orchestrator and an ICU, but no DFPC."""
    folder, endpoint = tmp_path_factory.mktemp("answers"), f"tcp/127.0.0.1:{free_port()}"
    with process_starter(endpoint, folder) as spawn:
        spawn("services.router")
        spawn("services.dpm", "--profile", PROFILE, "--http", f"127.0.0.1:{free_port()}")
        spawn("services.orchestrator", "--profile", PROFILE)
        spawn("services.icu", "--profile", PROFILE)
        with Bus.open(endpoint, name="producer", wait_s=20) as bus:
            wanted = {keys.alive("mana", s) for s in ("dpm", "orchestrator", "icu")}
            eventually(lambda: wanted <= bus.alive(keys.alive("mana", "*")), 40, "start-up")
            put(bus, "dem", patch(0.0, 1.0, age_s=10.0))
            for age_s in (6000, 0):
                base = TransformWithCovariance.from_transform(
                    T_SITE_BASE, parent="site", child="mana/base", stamp_ns=NOW_NS - age_s * 1_000_000_000
                )
                put(bus, "pose", base, child="mana/base")
            yield endpoint


@pytest.fixture
def client(endpoint_of_answers: str) -> Iterator[Client]:
    with Client(endpoint_of_answers) as client:
        yield client


@pytest.fixture
def bus(endpoint_of_answers: str) -> Iterator[Bus]:
    with Bus.open(endpoint_of_answers, name="raw", wait_s=10) as bus:
        yield bus


@pytest.fixture
def session(endpoint_of_answers: str) -> Iterator[zenoh.Session]:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint_of_answers]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as result:
        yield result


def test_a_map_by_reference_states_that_it_is_stored_as_an_elevation_map(bus: Bus) -> None:
    parameters = {"type": "dem", "region": REGION, "as": "Map", "deliver": "reference", "deadline_ms": 10000}
    reply = bus.call(REQUEST, parameters, timeout_s=11)
    delivered, body = reply.attachment["delivered"], reply.body()
    assert (reply.attachment["kind"], body["type"], delivered["as"]) == (
        "reference",
        "ElevationMap",
        "ElevationMap",
    )
    assert any("asked Map" in d for d in delivered["differences"])
    stored = bus.call(keys.dpm_rpc("ground", "get"), {"id": body["id"], "as": "Map", "format": "uper"})
    assert decode("Map", stored.payload, "uper").data.rows == 40
    inline = bus.call(REQUEST, {**parameters, "deliver": "inline"}, timeout_s=11).attachment["delivered"]
    assert (inline["as"], inline["differences"]) == ("Map", [])


def test_the_box_in_the_header_of_a_map_includes_its_heights(client: Client) -> None:
    box = client.request("dem", robot="mana", region=REGION, as_type="Map").header.box_m
    assert box == pytest.approx((0.0, 0.0, 1.0, 2.0, 2.0, 1.0))
    moved = client.request(
        "dem", robot="mana", region=REGION, region_frame="site", frame="mana/base", as_type="Map"
    )
    assert moved.header.box_m is not None
    corner = T_SITE_BASE.inverse().apply([[0.0, 0.0, 1.0]])[0]
    assert moved.header.box_m[2] == pytest.approx(corner[2])


def test_cells_that_cannot_be_aggregated_to_the_requested_size_are_reported_as_finer(client: Client) -> None:
    answer = client.request("dem", robot="mana", region=REGION, resolution_m=0.07)
    assert answer.delivered["resolution_m"] == 0.05
    assert any("0.07" in d for d in answer.delivered["differences"])
    assert client.request("dem", robot="mana", region=REGION, resolution_m=0.1).delivered["differences"] == []


def test_a_region_with_insufficient_coverage_is_unavailable(client: Client) -> None:
    for region in ("circle:900,0,1", "bbox:0,0,10,10"):
        with pytest.raises(UnavailableError, match="coverage") as refused:
            client.request("dem", robot="mana", region=region, min_coverage=0.5, deadline_s=2)
        assert not isinstance(refused.value, DeadlineError)


def test_an_unknown_frame_is_not_found_at_once_and_a_known_one_without_pose_is_awaited(
    client: Client,
) -> None:
    for parameters in ({"frame": "nosuch"}, {"child": "mana/nosuch"}):
        with pytest.raises(ProductNotFoundError, match=r"frame '.*nosuch' is in neither"):
            client.request("pose", robot="mana", deadline_s=60, **parameters)
    with pytest.raises(ProductNotFoundError, match=r"frame '.*nosuch' is in neither"):
        client.request("dem", robot="mana", region="near:nosuch,3", deadline_s=60)
    with pytest.raises(UnavailableError):
        client.request("pose", robot="minnie", frame="minnie/odom", deadline_s=1)


@pytest.mark.slow
def test_an_unattainable_age_limit_ends_with_deadline(bus: Bus) -> None:
    for _ in range(6):
        parameters = {"type": "pose", "max_age_s": 0.0001, "deadline_ms": 1000}
        with pytest.raises(DeadlineError) as late:
            bus.call(REQUEST, parameters, timeout_s=5)
        assert "the DPM:" not in str(late.value)


def test_a_product_that_became_too_old_before_delivery_is_not_delivered(client: Client, bus: Bus) -> None:
    """Products at 20 Hz may exceed the age limit between search and delivery; none may be delivered then."""
    stop = threading.Event()

    def produce() -> None:
        seq = 100
        while not stop.wait(0.05):
            seq += 1
            pose = TransformWithCovariance.from_transform(
                UncertainTransform(T_SITE_BASE.matrix, T_SITE_BASE.covariance),
                parent="site",
                child="mana/base",
                stamp_ns=wall_ns() // 1000 * 1000,
            )
            put(bus, "pose", pose, child="mana/base", seq=seq)

    thread = threading.Thread(target=produce)
    thread.start()
    try:
        for max_age_s in (0.02, 0.03, 0.04, 0.05, 0.06):
            for _ in range(4):
                try:
                    answer = client.request("pose", robot="mana", max_age_s=max_age_s, deadline_s=0.6)
                except DeadlineError:
                    continue
                assert answer.delivered["age_s"] <= max_age_s
                assert answer.delivered["differences"] == []
    finally:
        stop.set()
        thread.join()


def test_an_error_names_its_request_also_if_the_name_was_generated(session: zenoh.Session) -> None:
    def error(selector: str) -> dict[str, Any]:
        (reply,) = session.get(selector, timeout=10)
        body: dict[str, Any] = msgpack.unpackb(reply.err.payload.to_bytes())
        return body

    for parameters in ("type=nonsense", "type=pose;max_age_s=0.0001;deadline_ms=300", "type=mesh;colour=red"):
        assert uuid.UUID(error(f"{REQUEST}?{parameters}")["request"])
        assert error(f"{REQUEST}?{parameters};request=mine")["request"] == "mine"
    assert error(f"{REQUEST}?type=pose;type=dem;request=mine")["request"] == "mine"


def test_a_plain_zenoh_query_gets_one_complete_answer_even_if_it_fails_late(
    session: zenoh.Session,
) -> None:
    replies = list(session.get(f"{REQUEST}?type=pose;max_age_s=0.0001;deadline_ms=2000"))
    assert [r.ok is None for r in replies] == [True]
    body = msgpack.unpackb(replies[0].err.payload.to_bytes())
    assert body["code"] == "DEADLINE"


def test_progress_is_sent_on_request_or_to_clients_with_long_timeouts(bus: Bus) -> None:
    def kinds(**more: object) -> list[str]:
        return [
            r.attachment["kind"] for r in bus.call_stream(REQUEST, {"type": "pose", **more}, timeout_s=30)
        ]

    assert kinds() == ["product"]
    assert kinds(deadline_ms=20000)[0] == "progress"
    assert kinds(progress="true")[0] == "progress"
    assert kinds(deadline_ms=20000, progress="false") == ["product"]
    with pytest.raises(InputError, match="progress"):
        kinds(progress="maybe")


def test_the_icu_states_the_robots_that_it_serves(bus: Bus) -> None:
    for parameters in ({}, {"robot": "any"}):
        with pytest.raises(InputError) as refused:
            bus.call(keys.icu_rpc("ground", "modes"), parameters)
        assert str(refused.value).rstrip(")").endswith("a robot id")


@pytest.mark.slow
def test_each_of_many_requests_gets_exactly_one_final_reply_before_its_deadline(
    session: zenoh.Session,
) -> None:
    requests = [
        ("type=pose", 3.0),
        ("type=pose;max_age_s=0.0001", 1.0),
        ("type=pose;max_age_s=0.0001", 0.3),
        ("type=pose;max_age_s=0.0001", 3.0),
        (f"type=dem;region={REGION}", 3.0),
        ("type=dem;region=circle:900,0,1", 1.0),
        (f"type=dem;region={REGION};resolution_m=0.01", 2.0),
        ("type=pose;frame=nosuch", 3.0),
        ("type=nonsense", 1.0),
        (f"type=dem;region={REGION};deliver=reference", 3.0),
    ]
    faults: list[str] = []

    def send(text: str, deadline_s: float) -> None:
        selector = f"{REQUEST}?{text};progress=true;deadline_ms={deadline_s * 1000:.0f}"
        start_s = time.monotonic()
        final_replies, took_s, is_final = 0, 0.0, False
        none = zenoh.ConsolidationMode.NONE
        for reply in session.get(selector, timeout=deadline_s + 1, consolidation=none):
            is_final = reply.ok is None or msgpack.unpackb(reply.ok.attachment.to_bytes())["final"]
            final_replies += is_final
            took_s = time.monotonic() - start_s
        if final_replies != 1 or not is_final or took_s >= deadline_s:
            faults.append(f"{text}: {final_replies} final replies, {took_s:.3f} s of {deadline_s} s")

    for _ in range(3):
        threads = [threading.Thread(target=send, args=arguments) for arguments in requests * 2]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(30)
    assert not faults
