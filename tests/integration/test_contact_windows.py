# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two DPM processes that exchange products over a simulated link."""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import yaml

from cdff_common.bus import Bus, keys
from cdff_common.errors import ProductNotFoundError
from cdff_dev.contact.simulated_link import Direction, SimulatedLink
from cdff_dev.ports import free_udp_port as free_port
from tests.integration.conftest import process_starter
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
    down, up = Direction(1e6, 0.05, 0.02), Direction(1e6, 0.05, 0.02)
    for side in ("ground", "robot"):
        (tmp_path / side).mkdir()
    with (
        SimulatedLink(("127.0.0.1", port), down, up) as link,
        process_starter(ground, tmp_path / "ground") as on_ground,
        process_starter(robot, tmp_path / "robot") as on_robot,
    ):
        common = ("--http", "127.0.0.1:0", "--contact-plan", str(plan), "--contact-link")
        for spawn in (on_ground, on_robot):
            spawn("services.router")
        on_ground("services.dpm", *common, f"udp/127.0.0.1:{port}")
        on_robot("services.dpm", *common, f"udp/127.0.0.1:{link.port}", "--contact-robot", "mana")
        with Bus.open(robot, name="test", wait_s=60) as bus:
            call_when_alive(bus, keys.dpm_rpc(keys.GROUND, "stat"))
            call = {"payload": payload, "encoding": encoding, "attachment": attachment, "timeout_s": 60.0}
            stored = bus.call(keys.dpm_rpc(keys.GROUND, "put"), names, **call).body()
        with Bus.open(ground, name="test", wait_s=60) as bus:
            call_when_alive(bus, keys.dpm_rpc(keys.GROUND, "stat"))
            copied = fetch_when_there(bus, stored["id"])
            status = bus.call(keys.dpm_rpc(keys.GROUND, "contact"), {"what": "status"}, timeout_s=60.0).body()
    assert copied == payload
    assert status["robots"]["mana"]["stored"] == 1


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
