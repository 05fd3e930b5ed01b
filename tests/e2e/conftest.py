# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The whole system running on the simulated traverse, for tests that kill parts of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from cdff_common.bus import Bus
from cdff_common.interfaces.profile import load_profile
from cdff_common.resources import deploy_folder
from cdff_dev.missions.requests import wait_for_clock
from cdff_dev.missions.stage import Stage
from cdff_dev.ports import free_port
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.store import simulated_log


@pytest.fixture(scope="module")
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture(scope="module")
def http() -> str:
    return f"127.0.0.1:{free_port()}"


@pytest.fixture(scope="module")
def traverse() -> Path:
    """The log of the simulated traverse, simulated once and then cached."""
    return simulated_log(load_scenario("rover_traverse"))


@pytest.fixture(scope="module")
def stage(endpoint: str, http: str, traverse: Path) -> Iterator[Stage]:
    """Every service of the rover profile; the simulated traverse is played at 0.3 of real time."""
    path = deploy_folder() / "profiles" / "rover_traverse.yaml"
    with (
        Stage(load_profile(path), path, endpoint, http) as running,
        Bus.open(endpoint, name="test", wait_s=20) as bus,
    ):
        running.wait_ready(bus)
        running.play(str(traverse), 0.3)
        wait_for_clock(bus, running.check_running)
        yield running


def process_of(stage: Stage, name: str) -> psutil.Process:
    """Return the process that the supervisor of a stage runs under this name."""
    arguments = ["--process", name] if name.startswith(("mana", "minnie")) else [f"services.{name}"]
    for child in psutil.Process(stage.supervisor_pid).children():
        try:
            line = child.cmdline()
        except psutil.Error:  # the process has just ended
            continue
        if all(argument in line for argument in arguments):
            return child
    raise AssertionError(f"no process {name} under the supervisor")
