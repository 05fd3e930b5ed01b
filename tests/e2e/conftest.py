# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A whole system on the simulated traverse, for tests that break parts of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from cdff_common.bus import Bus
from cdff_common.interfaces.profile import load_profile
from cdff_dev.demo.commands import DEPLOY
from cdff_dev.demo.run import wait_for_clock
from cdff_dev.demo.stage import Stage
from cdff_dev.ports import free_port
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.store import simulated_log


@pytest.fixture(scope="session")
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture(scope="session")
def http() -> str:
    return f"127.0.0.1:{free_port()}"


@pytest.fixture(scope="session")
def traverse() -> Path:
    """The log of the simulated traverse, made once and kept in the cache."""
    return simulated_log(load_scenario("rover_traverse"))


@pytest.fixture(scope="session")
def stage(endpoint: str, http: str, traverse: Path) -> Iterator[Stage]:
    """Every service of the rover profile, and the simulated traverse played slowly enough to last for all tests."""
    path = DEPLOY / "profiles" / "rover_traverse.yaml"
    with Stage(load_profile(path), path, endpoint, http) as running, Bus.open(endpoint, name="test", wait_s=20) as bus:
        running.wait_ready(bus)
        running.play(str(traverse), 0.3)
        wait_for_clock(bus, running.check_running)
        yield running


def process_of(stage: Stage, name: str) -> psutil.Process:
    """The process that the supervisor of a stage runs under a name of its plan."""
    needle = ["--process", name] if name.startswith(("mana", "minnie")) else [f"services.{name}"]
    for child in psutil.Process(stage.supervisor_pid).children():
        try:
            line = child.cmdline()
        except psutil.Error:  # it ends at this moment
            continue
        if all(part in line for part in needle):
            return child
    raise AssertionError(f"no process {name} under the supervisor")
