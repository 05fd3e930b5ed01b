# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An orchestrator of a robot and one on the ground: delegation, take-over after a kill, and hand-over."""

from __future__ import annotations

import json
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Bus, Reply, keys
from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError
from cdff_dev.ports import free_port
from tests.integration.conftest import Spawn, process_starter
from tests.integration.conftest import wait_until as eventually
from tests.integration.troublemaker_mission import PROFILE, start_services, wait_for_services
from tests.support.relay import Relay
from tests.support.wheel_odometry import Driver

pytestmark = pytest.mark.integration

#: Longest time from the end of the token of a robot's orchestrator to the control by the ground, seconds.
TAKE_OVER_LIMIT_S = 3.0
GROUND_REQUEST = keys.orchestrator_rpc("ground", "request")


class Fleet:
    """The services of a mission in which mana has an orchestrator; that of the ground leads minnie."""

    def __init__(self, spawn: Spawn, endpoint: str, folder: Path) -> None:
        self.endpoint, self.folder, self._spawn = endpoint, folder, spawn
        start_services(spawn)
        spawn("services.orchestrator", "--profile", PROFILE, "--scope", "ground")
        self.start_own()
        others = keys.alive("ground", "orchestrator"), keys.alive("minnie", "orchestrator_ground")
        wait_for_services(endpoint, *others)

    def start_own(self) -> None:
        """Start the orchestrator of mana."""
        self.own = self._spawn("services.orchestrator", "--profile", PROFILE, "--scope", "mana")

    def kill_own(self) -> None:
        self.own.send_signal(signal.SIGKILL)
        self.own.wait(5)

    def journal(self, scope: str) -> list[dict[str, Any]]:
        path = self.folder / "data" / f"orchestrator_{scope}" / "journal.jsonl"
        return [json.loads(line) for line in path.read_text().splitlines()]

    def records(self, scope: str, kind: str) -> list[dict[str, Any]]:
        """Return the records of a kind in the journal of a scope, without those about minnie."""
        return [r for r in self.journal(scope) if r["kind"] == kind and r.get("robot") != "minnie"]


class Standing:
    """A standing request under a scope, in a thread of its own."""

    def __init__(self, endpoint: str, lease_s: float, key: str = GROUND_REQUEST) -> None:
        self.replies: list[Reply] = []
        self.error: CdffError | None = None
        self._endpoint, self._lease_s, self._key = endpoint, lease_s, key
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        parameters = {"type": "pose", "every_s": 0.2, "deadline_ms": 1000 * self._lease_s}
        parameters |= {"robot": "mana"} if self._key == GROUND_REQUEST else {}
        with Bus.open(self._endpoint, name="standing") as bus:
            try:
                self.replies += bus.call_stream(self._key, parameters, timeout_s=self._lease_s + 5)
            except CdffError as error:
                self.error = error

    @property
    def products(self) -> int:
        return sum(r.attachment["kind"] == "product" for r in list(self.replies))

    def wait_for_more(self, limit_s: float) -> None:
        before = self.products
        eventually(lambda: self.products > before + 2, limit_s, "further poses")

    def finals(self) -> list[Reply]:
        self._thread.join(self._lease_s + 10)
        assert self.error is None, self.error
        return [r for r in self.replies if r.final]


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    folder, endpoint = tmp_path_factory.mktemp("fleet"), f"tcp/127.0.0.1:{free_port()}"
    with process_starter(endpoint, folder) as spawn:
        yield Fleet(spawn, endpoint, folder)


@pytest.fixture
def driver(fleet: Fleet) -> Iterator[Driver]:
    with Bus.open(fleet.endpoint, name="driver") as bus:
        result = Driver(bus)
        yield result
        result.stop()


def test_the_ground_delegates_a_request_to_the_orchestrator_of_the_robot(
    fleet: Fleet, driver: Driver
) -> None:
    parameters = {"type": "pose", "robot": "mana", "max_age_s": 0.9, "deadline_ms": 20_000}
    replies = list(driver.bus.call_stream(GROUND_REQUEST, parameters, timeout_s=25))
    assert [r.attachment["kind"] for r in replies if r.final] == ["product"]
    assert replies[-1].attachment["producer"] == "troublemaker/Troublemaker/1"
    activated = [r["dfpc"] for r in fleet.records("mana", "activation")]
    assert "mana/troublemaker" in activated
    assert not fleet.records("ground", "activation")
    delegated = [r["request"] for r in fleet.records("mana", "job") if "request" in r]
    assert [r["deliver"] for r in delegated] == ["none"]
    eventually(lambda: "deactivated" in driver.events, 15, "deactivation by the owner")


def test_a_delegated_acquisition_is_made_once_for_each_request(fleet: Fleet, driver: Driver) -> None:
    parameters = {"type": "pose", "robot": "mana", "acquire": "pan_deg:20", "deadline_ms": 20_000}
    captured = [
        driver.bus.call(GROUND_REQUEST, parameters, timeout_s=25).attachment["t1_ns"] for _ in range(2)
    ]
    assert driver.acquired == [{"pan_deg": 20.0, "tilt_deg": 0.0}] * 2
    assert captured[0] < captured[1]
    eventually(lambda: "deactivated" in driver.events, 15, "deactivation by the owner")


@pytest.mark.req("CDFF-SUP-196")
def test_a_standing_request_outlives_the_orchestrator_of_its_robot_and_no_dfpc_starts_twice(
    fleet: Fleet, driver: Driver
) -> None:
    standing = Standing(fleet.endpoint, lease_s=25.0)
    eventually(lambda: standing.products > 2, 20, "poses")
    fleet.kill_own()
    killed_s = monotonic_s()
    eventually(lambda: bool(fleet.records("ground", "control")), 10, "the take-over")
    assert monotonic_s() - killed_s < TAKE_OVER_LIMIT_S + 1.0  # a second for the search of the journal
    standing.wait_for_more(10)
    # A client of the robot's scope is answered by the ground.
    key = keys.orchestrator_rpc("mana", "request")
    reply = driver.bus.call(key, {"type": "pose", "max_age_s": 2, "deadline_ms": 8000}, timeout_s=10)
    assert reply.attachment["kind"] == "product"
    fleet.start_own()
    eventually(lambda: fleet.records("ground", "control")[-1]["action"] == "hand_back", 20, "the hand-over")
    assert [r["action"] for r in fleet.records("ground", "control")] == ["take_over", "hand_back"]
    standing.wait_for_more(10)
    (final,) = standing.finals()
    assert final.attachment["kind"] == "end"
    eventually(lambda: "deactivated" in driver.events, 15, "deactivation by the owner")
    assert driver.events == ["activated", "deactivated"]
    assert fleet.records("mana", "activation")[-1]["action"] == "deactivate"
    assert "handed over" in {r.get("reason") for r in fleet.records("mana", "activation")}


def test_a_second_orchestrator_of_a_scope_ends_with_the_reason(fleet: Fleet) -> None:
    for scope in ("mana", "ground"):
        other = str(fleet.folder / f"other_{scope}")
        process = fleet._spawn(
            "services.orchestrator", "--profile", PROFILE, "--scope", scope, "--data-dir", other
        )
        assert process.wait(30) == 1
    log = (fleet.folder / "services.orchestrator.log").read_text()
    assert "another orchestrator leads mana" in log
    assert "another orchestrator leads ground" in log


@pytest.mark.req("CDFF-SUP-196")
def test_in_a_partition_the_robot_keeps_its_orchestrator_and_is_not_orchestrated_twice_afterwards(
    tmp_path: Path,
) -> None:
    ground, rover = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    profile = ("--profile", PROFILE)
    for side in ("ground", "rover"):
        (tmp_path / side).mkdir()
    with (
        Relay(("127.0.0.1", int(ground.rsplit(":", 1)[1]))) as link,
        process_starter(ground, tmp_path / "ground") as on_ground,
        process_starter(rover, tmp_path / "rover") as on_rover,
    ):
        on_ground("services.router")
        on_ground("services.dpm", *profile, "--http", f"127.0.0.1:{free_port()}")
        on_ground("services.orchestrator", *profile, "--scope", "ground")
        on_rover("services.router", "--scope", "mana", "--uplink", f"tcp/127.0.0.1:{link.port}")
        on_rover("services.icu", *profile, "--scope", "mana")
        on_rover("services.dfpc_host", *profile, "--process", "mana_troublemaker")
        on_rover("services.orchestrator", *profile, "--scope", "mana")
        with (
            Bus.open(ground, name="ground", wait_s=20) as bus,
            Bus.open(rover, name="rover", wait_s=20) as own,
        ):
            wanted = {keys.alive("mana", s) for s in ("orchestrator", "icu", "troublemaker")}
            wanted |= {keys.alive("ground", s) for s in ("orchestrator", "dpm")}
            for end in (bus, own):
                eventually(lambda end=end: wanted <= end.alive(keys.alive("*", "*")), 60, "start-up")
            driver = Driver(own)
            standing = Standing(ground, lease_s=50.0)
            eventually(lambda: standing.products > 2, 20, "poses")
            journal = tmp_path / "ground" / "data" / "orchestrator_ground" / "journal.jsonl"

            def control() -> list[str]:
                records = (json.loads(line) for line in journal.read_text().splitlines())
                return [r["action"] for r in records if r["kind"] == "control" and r["robot"] == "mana"]

            link.cut()
            eventually(lambda: control() == ["take_over"], 20, "the end of the lease on the bus")
            # The robot's own orchestrator still answers on the robot, without a DPM.
            parameters = {"type": "pose", "max_age_s": 2, "deadline_ms": 8000}
            reply = own.call(keys.orchestrator_rpc("mana", "request"), parameters, timeout_s=10)
            assert reply.attachment["kind"] == "product"
            assert reply.attachment["delivered"]["age_s"] < 2
            link.restore()
            eventually(lambda: control() == ["take_over", "hand_back"], 20, "the hand-over")
            standing.wait_for_more(20)
            (final,) = standing.finals()
            assert final.attachment["kind"] == "end"
            eventually(lambda: "deactivated" in driver.events, 15, "deactivation by the owner")
            assert driver.events == ["activated", "deactivated"]
            driver.stop()
