# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Orders to simulated rovers over a real bus."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.errors import InputError
from cdff_dev.missions import orders
from cdff_dev.missions.driven import Driven
from cdff_dev.simulate.scenario import Scenario, load_scenario
from cdff_dev.simulate.world import make_world
from tests.integration.conftest import wait_until

pytestmark = pytest.mark.integration

TICK_NS = 500_000_000


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """The shipped outing on 24 m of bare ground."""
    told = load_scenario("outing").model_dump()
    told["duration_s"] = 4.0
    told["terrain"] |= {"fine_half_width_m": 12.0, "far_half_width_m": 30.0}
    told["terrain"]["craters"] |= {"count": 0}
    told["terrain"]["rocks"] |= {"count": 0}
    told["lidar"] |= {"rings": 4, "columns": 64}
    return Scenario.model_validate(told)


@pytest.fixture
def driven(scenario: Scenario) -> Driven:
    return Driven(make_world(scenario), None)


@pytest.fixture
def bus(endpoint: str, driven: Driven) -> Iterator[Bus]:
    """A caller's bus, on which the simulator answers; the first tick is made."""
    next(driven.samples())
    with (
        Bus.open_router(endpoint),
        Bus.open(endpoint, name="simulator") as server,
        Bus.open(endpoint, name="autonomy") as caller,
    ):
        orders.serve(server, driven)
        wait_until(lambda: caller.alive(keys.alive("mana", "simulator")), what="the simulator's token")
        yield caller


@pytest.mark.req("CDFF-DEV-070")
def test_a_rover_that_is_told_to_drive_says_when_it_begins_and_ends(
    bus: Bus, driven: Driven, scenario: Scenario
) -> None:
    rover = orders.Locomotion(bus, "mana")
    begin_ns, end_ns = rover.drive(np.array([[0.0, 0.0], [2.0, 0.0]]))
    assert begin_ns == scenario.epoch_ns + TICK_NS
    assert (end_ns - begin_ns) % TICK_NS == 0
    assert end_ns - begin_ns > 2_000_000_000
    with pytest.raises(InputError, match="mana drives for another"):
        rover.drive(np.array([[0.0, 0.0], [1.0, 0.0]]))
    source = driven.samples()
    while driven.ready_ns() < end_ns:
        next(source)
    with pytest.raises(InputError, match="left the begin"):
        rover.follow()


def test_a_rover_that_is_told_to_follow_drives_the_way_of_its_scenario(bus: Bus, scenario: Scenario) -> None:
    begin_ns, end_ns = orders.Locomotion(bus, "mana").follow()
    assert (begin_ns, end_ns - begin_ns) == (scenario.epoch_ns + TICK_NS, 4_000_000_000)


def test_orders_that_are_none_are_refused_and_the_next_is_taken(bus: Bus) -> None:
    refused: list[tuple[bytes, str]] = [
        (b"", "not MessagePack"), (b"\xc1 nothing", "not MessagePack"),
        (pack([1]), "expected a list"), (pack({}), "expected a list"),
        (pack({"way_m": "ahead"}), "expected a list"), (pack({"way_m": 3}), "expected a list"),
        (pack({"way_m": [[0, 0]] * 10_001}), "at most 10000"), (pack({"way_m": []}), "at least two"),
        (pack({"way_m": [[0, 0]]}), "at least two"), (pack({"way_m": [[0, 0], [1, "x"]]}), "in metres"),
        (pack({"way_m": [[0, 0], [1]]}), "in metres"), (pack({"way_m": [[0, 0], [{}, 1]]}), "in metres"),
        (pack({"way_m": [[0, 0], [float("nan"), 0]]}), "finite"),
        (pack({"way_m": [[0, 0], [100, 0]]}), "the ground ends"),
    ]  # fmt: skip

    def told(payload: bytes) -> Any:
        return bus.call(orders.key("mana", "drive"), payload=payload, timeout_s=10.0).body()

    for payload, said in refused:
        with pytest.raises(InputError, match=said):
            told(payload)
    assert told(pack({"way_m": [[0, 0], [1, 0]]}))["end_ns"] > 0
