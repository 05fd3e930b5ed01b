# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Drive commands to simulated rovers over a real bus."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.errors import InputError
from cdff_dev.missions import drive_commands
from cdff_dev.missions.driven_log import GrowingLog
from cdff_dev.simulate.scenario import Scenario, load_scenario
from cdff_dev.simulate.world import make_world
from tests.integration.conftest import wait_until

pytestmark = pytest.mark.integration

TICK_NS = 500_000_000


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """The shipped scenario ``outing`` on 24 m of ground without craters and rocks."""
    scenario = load_scenario("outing").model_dump()
    scenario["duration_s"] = 4.0
    scenario["terrain"] |= {"fine_half_width_m": 12.0, "far_half_width_m": 30.0}
    scenario["terrain"]["craters"] |= {"count": 0}
    scenario["terrain"]["rocks"] |= {"count": 0}
    scenario["lidar"] |= {"rings": 4, "columns": 64}
    return Scenario.model_validate(scenario)


@pytest.fixture
def simulation(scenario: Scenario) -> GrowingLog:
    return GrowingLog(make_world(scenario), None)


@pytest.fixture
def bus(endpoint: str, simulation: GrowingLog) -> Iterator[Bus]:
    """The bus of a caller of the simulator, after the first simulation tick."""
    next(simulation.samples())
    with (
        Bus.open_router(endpoint),
        Bus.open(endpoint, name="simulator") as server,
        Bus.open(endpoint, name="autonomy") as caller,
    ):
        drive_commands.serve(server, simulation)
        wait_until(lambda: caller.alive(keys.alive("mana", "simulator")), what="the simulator's token")
        yield caller


@pytest.mark.req("CDFF-DEV-070")
def test_a_commanded_drive_reports_its_start_and_end(
    bus: Bus, simulation: GrowingLog, scenario: Scenario
) -> None:
    rover = drive_commands.Locomotion(bus, "mana")
    start_ns, end_ns = rover.drive(np.array([[0.0, 0.0], [2.0, 0.0]]))
    assert start_ns == scenario.epoch_ns + TICK_NS
    assert (end_ns - start_ns) % TICK_NS == 0
    assert end_ns - start_ns > 2_000_000_000
    with pytest.raises(InputError, match="mana drives for another"):
        rover.drive(np.array([[0.0, 0.0], [1.0, 0.0]]))
    source = simulation.samples()
    while simulation.ready_ns() < end_ns:
        next(source)
    with pytest.raises(InputError, match="left the start"):
        rover.follow()


def test_a_rover_commanded_to_follow_drives_the_track_of_its_scenario(bus: Bus, scenario: Scenario) -> None:
    start_ns, end_ns = drive_commands.Locomotion(bus, "mana").follow()
    assert (start_ns, end_ns - start_ns) == (scenario.epoch_ns + TICK_NS, 4_000_000_000)


def test_invalid_drive_commands_are_refused_and_the_next_valid_one_is_accepted(bus: Bus) -> None:
    invalid: list[tuple[bytes, str]] = [
        (b"", "not MessagePack"),
        (b"\xc1 nothing", "not MessagePack"),
        (pack([1]), "expected a list"),
        (pack({}), "expected a list"),
        (pack({"path_m": "ahead"}), "expected a list"),
        (pack({"path_m": 3}), "expected a list"),
        (pack({"path_m": [[0, 0]] * 10_001}), "at most 10000"),
        (pack({"path_m": []}), "at least two"),
        (pack({"path_m": [[0, 0]]}), "at least two"),
        (pack({"path_m": [[0, 0], [1, "x"]]}), "in metres"),
        (pack({"path_m": [[0, 0], [1]]}), "in metres"),
        (pack({"path_m": [[0, 0], [{}, 1]]}), "in metres"),
        (pack({"path_m": [[0, 0], [float("nan"), 0]]}), "finite"),
        (pack({"path_m": [[0, 0], [100, 0]]}), "the terrain ends"),
    ]

    def drive(payload: bytes) -> Any:
        return bus.call(drive_commands.key("mana", "drive"), payload=payload, timeout_s=10.0).body()

    for payload, reason in invalid:
        with pytest.raises(InputError, match=reason):
            drive(payload)
    assert drive(pack({"path_m": [[0, 0], [1, 0]]}))["end_ns"] > 0
