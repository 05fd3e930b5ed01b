# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outcome of a request when a DFPC or sensor fails while it waits, with real processes."""

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
from tests.support.wheel_odometry import Driver

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "orchestrator_failures.yaml")
HOST = ("services.dfpc_host", "--profile", PROFILE, "--process")


class FaultyDriver(Driver):
    """A driver that repeats the same fault while ``repeated_child`` is set."""

    repeated_child = ""

    def send(self, child: str) -> None:
        super().send(self.repeated_child or child)


@pytest.fixture(scope="module")
def running_system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Spawn]]:
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
def bus(running_system: tuple[str, Spawn]) -> Iterator[Bus]:
    """A bus, after every service has started and no DFPC is active."""
    with Bus.open(running_system[0], name="driver", wait_s=20) as bus:
        services = ("dpm", "orchestrator", "icu", "troublemaker", "understudy")
        wanted = {keys.alive("mana", s) for s in services}
        eventually(lambda: wanted <= bus.alive(keys.alive("mana", "*")), 40, "start-up")
        eventually(lambda: all(state(bus, d) != "active" for d in services[3:]), 20, "an idle system")
        yield bus


@pytest.fixture
def driver(bus: Bus) -> Iterator[FaultyDriver]:
    result = FaultyDriver(bus)
    yield result
    result.stop()


def state(bus: Bus, dfpc: str) -> str:
    """Return the state of a DFPC; "active" if its process does not answer."""
    try:
        return str(bus.call(keys.dfpc_rpc("mana", dfpc, "status")).body()["state"])
    except UnavailableError:
        return "active"


def request_in_thread(endpoint: str, **parameters: Any) -> tuple[threading.Thread, list[Any]]:
    """Request a pose in a thread; the list receives the answer or the error."""
    results: list[Any] = []

    def run() -> None:
        with Client(endpoint) as client:
            try:
                results.append(client.request("pose", robot="mana", **parameters))
            except UnavailableError as error:
                results.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    return thread, results


@pytest.mark.req("CDFF-SUP-027")
@pytest.mark.parametrize("trouble", ["trouble/raise", "trouble/fail", "trouble/hang"])
@pytest.mark.slow
def test_a_provider_that_raises_fails_or_hangs_is_replaced_by_another_one(
    running_system: tuple[str, Spawn], driver: FaultyDriver, trouble: str, bus: Bus
) -> None:
    driver.repeated_child = trouble
    thread, results = request_in_thread(running_system[0], max_age_s=0.5, deadline_s=40)
    thread.join(45)
    assert results[0].delivered["source"].startswith("understudy"), results
    if trouble == "trouble/hang":  # the watchdog ended the host; without a supervisor, the test restarts it
        driver.repeated_child = ""
        running_system[1](*HOST, "mana_troublemaker")


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-027")
def test_a_sensor_lost_during_a_request_is_reported_at_once_and_works_after_recovery(
    running_system: tuple[str, Spawn], bus: Bus
) -> None:
    thread, results = request_in_thread(running_system[0], max_age_s=0.1, deadline_s=60)
    eventually(lambda: state(bus, "troublemaker") == "active", 20, "activation of the DFPC")
    bus.call(keys.icu_rpc("mana", "fault"), {"sensor": "wheels", "lost": "no power"})
    thread.join(10)
    assert not thread.is_alive()
    assert "sensor mana/wheels is lost: no power" in str(results[0])
    bus.call(keys.icu_rpc("mana", "fault"), {"sensor": "wheels"})
    driver = FaultyDriver(bus)
    try:
        thread, results = request_in_thread(running_system[0], max_age_s=0.5, deadline_s=20)
        thread.join(25)
        assert results[0].value is not None
    finally:
        driver.stop()


@pytest.mark.req("CDFF-SUP-027")
@pytest.mark.slow
def test_a_sensor_without_samples_is_reported_as_the_reason_at_the_deadline(
    running_system: tuple[str, Spawn], bus: Bus
) -> None:
    thread, results = request_in_thread(running_system[0], max_age_s=0.1, deadline_s=20)
    thread.join(30)
    assert isinstance(results[0], DeadlineError)
    assert "no sample of mana/wheels reaches mana/" in str(results[0])


@pytest.mark.req("CDFF-SUP-144")
def test_a_dfpc_is_cleaned_up_configured_and_activated_by_its_verbs(bus: Bus) -> None:
    def call(verb: str) -> str:
        return str(bus.call(keys.dfpc_rpc("mana", "understudy", verb)).body()["state"])

    assert call("clean_up") == "unconfigured"
    assert bus.call(keys.dfpc_rpc("mana", "understudy", "describe")).body()["config_hash"] == ""
    assert call("clean_up") == "unconfigured"
    assert call("configure") == "inactive"
    with pytest.raises(InputError, match="expected sensor/wheels/odometry"):
        bus.call(
            keys.dfpc_rpc("mana", "understudy", "activate"), payload=pack({"inputs": {"poses": "sensor/x/y"}})
        )
    chosen = pack({"inputs": {"poses": "sensor/wheels/odometry"}})
    bus.call(keys.dfpc_rpc("mana", "understudy", "activate"), payload=chosen)
    assert call("activate") == "active"
    assert call("deactivate") == "inactive"
