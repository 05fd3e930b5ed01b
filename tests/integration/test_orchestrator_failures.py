# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a request comes to when a DFPC or a sensor fails while it waits, among real processes."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.client import Client
from cdff_common.errors import DeadlineError, InputError, UnavailableError
from cdff_dev.ports import free_port
from tests.integration.conftest import Spawn, process_starter
from tests.integration.conftest import wait_until as eventually
from tests.integration.test_orchestrator import Driver

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "orchestrator_failures.yaml")
HOST = ("services.dfpc_host", "--profile", PROFILE, "--process")


class Stubborn(Driver):
    """A driver that sends the same trouble for as long as it is told to."""

    always = ""

    def send(self, child: str) -> None:
        super().send(self.always or child)


@pytest.fixture(scope="module")
def spawned(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Spawn]]:
    folder, endpoint = tmp_path_factory.mktemp("failures"), f"tcp/127.0.0.1:{free_port()}"
    with process_starter(endpoint, folder) as spawn:
        spawn("services.router")
        spawn("services.dpm", "--profile", PROFILE, "--http", f"127.0.0.1:{free_port()}")
        spawn("services.orchestrator", "--profile", PROFILE)
        spawn("services.icu", "--profile", PROFILE)
        for name in ("mana_troublemaker", "mana_understudy"):
            spawn(*HOST, name)
        yield endpoint, spawn


@pytest.fixture
def bus(spawned: tuple[str, Spawn]) -> Iterator[Bus]:
    """Before a test everything is there and idle."""
    with Bus.open(spawned[0], name="driver", wait_s=20) as made:
        services = ("dpm", "orchestrator", "icu", "troublemaker", "understudy")
        wanted = {keys.alive("mana", s) for s in services}
        eventually(lambda: wanted <= made.alive(keys.alive("mana", "*")), 40, "start-up")
        eventually(lambda: all(state(made, d) != "active" for d in services[3:]), 20, "an idle system")
        yield made


@pytest.fixture
def driver(bus: Bus) -> Iterator[Stubborn]:
    made = Stubborn(bus)
    yield made
    made.stop()


def state(bus: Bus, dfpc: str) -> str:
    """Of a DFPC; "active" while its process cannot say."""
    try:
        return str(bus.call(keys.dfpc_rpc("mana", dfpc, "status")).body()["state"])
    except UnavailableError:
        return "active"


def ask(endpoint: str, **wish: Any) -> tuple[threading.Thread, list[Any]]:
    """Ask in a thread; the answer or the error comes into the list."""
    got: list[Any] = []

    def run() -> None:
        with Client(endpoint) as client:
            try:
                got.append(client.request("pose", robot="mana", **wish))
            except UnavailableError as error:
                got.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    return thread, got


@pytest.mark.req("CDFF-SUP-027")
@pytest.mark.parametrize("trouble", ["trouble/raise", "trouble/fail", "trouble/hang"])
def test_what_raises_refuses_or_hangs_is_planned_around(
    spawned: tuple[str, Spawn], driver: Stubborn, trouble: str, bus: Bus
) -> None:
    driver.always = trouble
    thread, got = ask(spawned[0], max_age_s=0.5, deadline_s=40)
    thread.join(45)
    assert got[0].delivered["source"].startswith("understudy"), got
    if trouble == "trouble/hang":  # its watchdog ended it, and nobody else starts it again here
        driver.always = ""
        spawned[1](*HOST, "mana_troublemaker")


@pytest.mark.req("CDFF-SUP-027")
def test_a_sensor_lost_while_a_request_waits_is_told_at_once_and_works_when_it_is_back(
    spawned: tuple[str, Spawn], bus: Bus
) -> None:
    thread, got = ask(spawned[0], max_age_s=0.1, deadline_s=60)
    eventually(lambda: state(bus, "troublemaker") == "active", 20, "the request to wait")
    bus.call(keys.icu_rpc("mana", "fault"), {"sensor": "wheels", "lost": "no power"})
    thread.join(10)
    assert not thread.is_alive()
    assert "sensor mana/wheels is lost: no power" in str(got[0])
    bus.call(keys.icu_rpc("mana", "fault"), {"sensor": "wheels"})
    driver = Stubborn(bus)
    try:
        thread, got = ask(spawned[0], max_age_s=0.5, deadline_s=20)
        thread.join(25)
        assert got[0].value is not None
    finally:
        driver.stop()


@pytest.mark.req("CDFF-SUP-027")
def test_a_sensor_that_is_on_and_silent_is_the_reason_at_the_deadline(spawned: tuple[str, Spawn], bus: Bus) -> None:
    thread, got = ask(spawned[0], max_age_s=0.1, deadline_s=20)
    thread.join(30)
    assert isinstance(got[0], DeadlineError)
    assert "no sample of mana/wheels reaches mana/" in str(got[0])


@pytest.mark.req("CDFF-SUP-144")
def test_a_dfpc_is_cleaned_up_configured_and_activated_by_its_verbs(bus: Bus) -> None:
    def call(verb: str) -> str:
        return str(bus.call(keys.dfpc_rpc("mana", "understudy", verb)).body()["state"])

    assert call("clean_up") == "unconfigured"
    assert bus.call(keys.dfpc_rpc("mana", "understudy", "describe")).body()["config_hash"] == ""
    assert call("clean_up") == "unconfigured"
    assert call("configure") == "inactive"
    with pytest.raises(InputError, match="expected sensor/wheels/odometry"):
        bus.call(keys.dfpc_rpc("mana", "understudy", "activate"), payload=pack({"inputs": {"poses": "sensor/x/y"}}))
    chosen = pack({"inputs": {"poses": "sensor/wheels/odometry"}})
    bus.call(keys.dfpc_rpc("mana", "understudy", "activate"), payload=chosen)
    assert call("activate") == "active"
    assert call("deactivate") == "inactive"
