# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A DFPC host whose disk is full: products in memory are reported, and so is their loss after a kill."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import on_map
from tests.integration.conftest import Eventually, Spawn, fill_disk
from tests.integration.test_dfpc_host import NAME, PROFILE, Robot

pytestmark = pytest.mark.slow


class AlarmedRobot(Robot):
    """A robot that also receives the alarms of its host, by kind."""

    def __init__(self, bus: Bus) -> None:
        super().__init__(bus)
        self.alarms: dict[str, Any] = {}
        bus.subscribe(keys.alarms("mana", "*"), on_map(self._on_alarms))

    def _on_alarms(self, _key: str, body: dict[str, Any]) -> None:
        self.alarms = {item["kind"]: item for item in body["items"]}


@pytest.fixture
def robot(
    small_disk: Path, router: subprocess.Popen[bytes], endpoint: str, spawn: Spawn
) -> Iterator[AlarmedRobot]:
    """A robot without a DPM."""
    with Bus.open(endpoint, name="robot", wait_s=30) as bus:
        yield AlarmedRobot(bus)


def test_products_of_a_host_on_a_full_disk_and_their_loss_are_reported(
    robot: AlarmedRobot, small_disk: Path, spawn: Spawn, eventually: Eventually
) -> None:
    def start() -> subprocess.Popen[bytes]:
        host = spawn("services.dfpc_host", "--profile", PROFILE, "--process", f"mana_{NAME}")
        eventually(robot.ready, timeout_s=60)
        return host

    host = start()
    robot.rpc("activate")
    ballast = fill_disk(small_disk)
    for x in range(5):
        robot.send(x=float(x))
    eventually(lambda: robot.rpc("status")["outbox_in_memory"] == 5, timeout_s=20)
    eventually(lambda: "5 products" in robot.alarms.get("outbox_in_memory", {}).get("what", ""), timeout_s=20)

    host.send_signal(signal.SIGKILL)
    host.wait()
    eventually(lambda: not robot.ready(), timeout_s=30)
    ballast.unlink()
    start()
    assert robot.rpc("status")["outbox_lost"] == 5
    eventually(lambda: "5 products" in robot.alarms.get("outbox_lost", {}).get("what", ""), timeout_s=20)


def test_products_in_memory_are_written_when_the_disk_has_space_again(
    robot: AlarmedRobot, small_disk: Path, spawn: Spawn, eventually: Eventually
) -> None:
    spawn("services.dfpc_host", "--profile", PROFILE, "--process", f"mana_{NAME}")
    eventually(robot.ready, timeout_s=60)
    robot.rpc("activate")
    ballast = fill_disk(small_disk)
    robot.send()
    eventually(lambda: "outbox_in_memory" in robot.alarms, timeout_s=30)
    ballast.unlink()
    eventually(lambda: "outbox_in_memory" not in robot.alarms, timeout_s=30)
    assert robot.rpc("status")["outbox_pending"] == 1
    assert robot.rpc("status")["outbox_in_memory"] == 0
