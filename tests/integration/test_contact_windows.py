# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two DPM processes that exchange products over a simulated link."""

from __future__ import annotations

import json
import time
import urllib.request
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import yaml

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from cdff_common.errors import CdffError, ProductNotFoundError
from cdff_dev.contact.simulated_link import Direction, SimulatedLink
from cdff_dev.ports import free_port as free_tcp_port
from cdff_dev.ports import free_udp_port as free_port
from tests.integration.conftest import process_starter, wait_until
from tests.support.dpm_products import cloud, put_arguments

pytestmark = pytest.mark.slow
_LIMIT_S = 120.0


def test_products_of_a_robot_are_in_the_dpm_of_the_ground_after_a_window(tmp_path: Path) -> None:
    names, payload, encoding, attachment = put_arguments(cloud(), "pointcloud")
    plan, port = tmp_path / "plan.yaml", free_port()
    now = datetime.now(UTC)
    window = {"robot": "mana", "start": now.isoformat(), "end": (now + timedelta(minutes=10)).isoformat()}
    plan.write_text(yaml.safe_dump({"windows": [window | {"rate_bit_s": 1e6}]}), encoding="utf-8")
    ground, robot = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    http = f"127.0.0.1:{free_tcp_port()}"
    down, up = Direction(1e6, 0.05, 0.02), Direction(1e6, 0.05, 0.02)
    for side in ("ground", "robot"):
        (tmp_path / side).mkdir()
    with (
        SimulatedLink(("127.0.0.1", port), down, up) as link,
        process_starter(ground, tmp_path / "ground") as on_ground,
        process_starter(robot, tmp_path / "robot") as on_robot,
    ):
        common = ("--contact-plan", str(plan), "--contact-link")
        for spawn in (on_ground, on_robot):
            spawn("services.router")
        on_ground("services.dpm", "--http", http, *common, f"udp/127.0.0.1:{port}")
        on_robot(
            "services.dpm",
            "--http",
            "127.0.0.1:0",
            *common,
            f"udp/127.0.0.1:{link.port}",
            "--contact-robot",
            "mana",
        )
        with Bus.open(robot, name="test", wait_s=60) as bus:
            call_when_alive(bus, keys.dpm_rpc(keys.GROUND, "stat"))
            call = {"payload": payload, "encoding": encoding, "attachment": attachment, "timeout_s": 60.0}
            stored = bus.call(keys.dpm_rpc(keys.GROUND, "put"), names, **call).body()
        with Bus.open(ground, name="test", wait_s=60) as bus:
            call_when_alive(bus, keys.dpm_rpc(keys.GROUND, "stat"))
            copied = fetch_when_there(bus, stored["id"])
            status = bus.call(keys.dpm_rpc(keys.GROUND, "contact"), {"what": "status"}, timeout_s=60.0).body()
            with urllib.request.urlopen(f"http://{http}/api/v1/contact", timeout=60.0) as answer:
                status_by_http = json.loads(answer.read())
    assert copied == payload
    assert status["robots"]["mana"]["stored"] == 1
    assert status_by_http["robots"]["mana"]["stored"] == 1


@pytest.mark.parametrize(
    ("has_plan", "reason"),
    [
        (False, "this DPM has no contact plan; start it with `cdff service dpm --contact-plan FILE`"),
        (True, "this is the DPM on mana; connect to the router of the ground"),
    ],
)
def test_a_dpm_that_is_not_the_end_of_the_ground_states_why(
    tmp_path: Path, has_plan: bool, reason: str
) -> None:
    plan, endpoint = tmp_path / "plan.yaml", f"tcp/127.0.0.1:{free_tcp_port()}"
    window = {"robot": "mana", "start": "2026-01-01T00:00:00Z", "end": "2026-01-01T00:01:00Z"}
    plan.write_text(yaml.safe_dump({"windows": [window | {"rate_bit_s": 1e6}]}), encoding="utf-8")
    link = ("--contact-link", f"udp/127.0.0.1:{free_port()}", "--contact-robot", "mana")
    options = ("--contact-plan", str(plan), *link) if has_plan else ()
    with process_starter(endpoint, tmp_path) as spawn:
        spawn("services.router")
        spawn("services.dpm", "--http", "127.0.0.1:0", *options)
        with Bus.open(endpoint, name="test", wait_s=60) as bus:
            call_when_alive(bus, keys.dpm_rpc(keys.GROUND, "stat"))
        with Client(endpoint) as client:
            wait_until(lambda: reason in refusal(client), 30, "the refusal")


def refusal(client: Client) -> str:
    """Return the error of a call of the exchange."""
    with pytest.raises(CdffError) as refused:
        client.contact()
    return str(refused.value)


def call_when_alive(bus: Bus, key: str) -> None:
    """Call until the service answers."""
    deadline_s = time.monotonic() + _LIMIT_S
    while not bus.alive(keys.alive(keys.GROUND, "dpm")):
        assert time.monotonic() < deadline_s, "the DPM does not start"
    bus.call(key, timeout_s=60.0)


def fetch_when_there(bus: Bus, product_id: str) -> bytes:
    """Return the payload of a product as soon as the DPM has it."""
    deadline_s = time.monotonic() + _LIMIT_S
    while True:
        try:
            return bytes(
                bus.call(keys.dpm_rpc(keys.GROUND, "get"), {"id": product_id}, timeout_s=60.0).payload
            )
        except ProductNotFoundError:
            assert time.monotonic() < deadline_s, "the product does not arrive"
            time.sleep(0.1)
