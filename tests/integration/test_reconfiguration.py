# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Requests select the implementation of a DFPC by its accuracy, and adjust parameters while it runs."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.client import Client
from cdff_common.errors import InputError
from tests.integration.conftest import wait_until as eventually
from tests.integration.troublemaker_mission import troublemaker_mission
from tests.support.wheel_odometry import Driver

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with troublemaker_mission(tmp_path_factory.mktemp("reconfiguration")) as endpoint:
        yield endpoint


@pytest.fixture
def driver(endpoint: str) -> Iterator[Driver]:
    with Bus.open(endpoint, name="driver") as bus:
        result = Driver(bus)
        yield result
        eventually(lambda: status(bus)["state"] == "inactive", 20, "deactivation")
        result.stop()


def status(bus: Bus) -> dict[str, Any]:
    body: dict[str, Any] = bus.call(keys.dfpc_rpc("mana", "troublemaker", "status")).body()
    return body


@pytest.mark.req("CDFF-SUP-197")
def test_the_cheap_implementation_serves_a_request_and_the_precise_one_bounds_on_the_accuracy(
    endpoint: str, driver: Driver
) -> None:
    with Client(endpoint) as client:
        cheap = client.request("pose", robot="mana", max_age_s=0.9)
        assert cheap.header.producer == "troublemaker/Troublemaker/1"
        explained = client.explain("pose", robot="mana", max_age_s=0.9, max_sigma_m=0.005)
        assert explained["plan"]["implementations"] == {"mana/troublemaker": "Precise"}
        precise = client.request("pose", robot="mana", max_age_s=0.9, max_sigma_m=0.005)
        assert precise.header.producer == "troublemaker/Precise/1"
        assert precise.delivered["sigma_m"] <= 0.005
    eventually(lambda: status(driver.bus)["state"] == "inactive", 20, "deactivation")
    assert (status(driver.bus)["implementation"], status(driver.bus)["adjusted"]) == ("Troublemaker", {})


@pytest.mark.req("CDFF-SUP-197")
def test_standing_requests_share_the_shortest_period_and_the_change_is_undone(
    endpoint: str, driver: Driver
) -> None:
    stops = [threading.Event(), threading.Event()]
    counts = [0, 0]

    def stand(i: int, every_s: float) -> None:
        with Client(endpoint) as client:
            for _ in client.standing("pose", robot="mana", every_s=every_s, lease_s=20, stop=stops[i]):
                counts[i] += 1

    def period_is(value: float | None) -> bool:
        return bool(status(driver.bus)["adjusted"] == ({} if value is None else {"period_s": value}))

    threads = [threading.Thread(target=stand, args=(i, every_s)) for i, every_s in enumerate((0.5, 0.2))]
    threads[0].start()
    eventually(lambda: period_is(0.5), 20, "the period of the first request")
    threads[1].start()
    eventually(lambda: period_is(0.2), 20, "the shorter period of the second request")
    before = list(counts)
    eventually(lambda: all(c > b + 2 for c, b in zip(counts, before, strict=True)), 20, "poses of both")
    stops[1].set()
    eventually(lambda: period_is(0.5), 20, "the period without the second request")
    stops[0].set()
    eventually(lambda: status(driver.bus)["state"] == "inactive", 20, "deactivation")
    assert period_is(None)
    for thread in threads:
        thread.join(30)
    assert driver.events.count("activated") == 1


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ({"parameters": {"period_s": 0.01}}, "expected 0.1 to 10"),
        ({"parameters": {"covariance_factor": 0.5}}, "covariance_factor is not adjustable"),
        ({"parameters": {"period_s": "fast"}}, "expected parameters"),
        ({"parameters": {"period_s": float("nan")}}, "expected parameters"),
        ({"implementation": "Fast"}, "the profile admits Troublemaker, Precise"),
        ({"speed": 1}, "expected a body"),
    ],
)
def test_a_configuration_that_is_not_admitted_is_refused(
    endpoint: str, body: dict[str, Any], fault: str
) -> None:
    with Bus.open(endpoint, name="caller") as bus, pytest.raises(InputError, match=fault):
        bus.call(keys.dfpc_rpc("mana", "troublemaker", "activate"), payload=pack(body))
