# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarms of the supervisor and of a DFPC host reach the DPM over the bus: real processes."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.errors import UnavailableError
from cdff_dev.ports import free_port
from services.supervisor.child import Limits
from services.supervisor.plan import ProcessSpec
from services.supervisor.profile_link import SupervisorLink
from services.supervisor.supervisor import Supervisor
from tests.integration.conftest import Eventually

pytestmark = pytest.mark.slow

PROFILE = """
name: alarms
robots:
- id: mana
  frames: [{parent: mana/base, child: mana/lidar, translation_m: [0.0, 0.0, 2.0]}]
"""


class Mission:
    """A supervisor in a thread with router, DPM, a process that hangs and one that fails."""

    def __init__(self, endpoint: str, folder: Path) -> None:
        (folder / "profile.yaml").write_text(PROFILE)
        environment = {
            "CDFF_CONNECT": endpoint,
            "CDFF_LISTEN": endpoint,
            "CDFF_PROFILE": str(folder / "profile.yaml"),
            "CDFF_DATA_DIR": str(folder / "data"),
            "CDFF_MEMORY_MB": "1",
        }

        def spec(name: str, *arguments: str) -> ProcessSpec:
            return ProcessSpec(name, (sys.executable, *arguments), environment, ())

        healthy = "from cdff_common.process import run_service; run_service('x', lambda stop: stop.wait())"
        specs = [
            spec("router", "-m", "services.router"),
            spec("dpm", "-m", "services.dpm", "--http", f"127.0.0.1:{free_port()}"),
            spec("hanging", "-c", healthy),
            spec("failing", "-c", "raise SystemExit(3)"),
        ]
        limits = Limits(backoff_first_s=0.01, backoff_longest_s=0.05, silence_s=3.0)
        self.supervisor = Supervisor(
            specs, folder, limits, link=SupervisorLink(endpoint, "ground", {"ground": {}})
        )
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.supervisor.run, args=(self.stop,))
        self.thread.start()
        self.bus = Bus.open(endpoint, name="test", wait_s=60)

    def call(self, verb: str, **parameters: object) -> Any:
        """Call a verb of the DPM under ``ground``."""
        return self.bus.call(keys.dpm_rpc("ground", verb), parameters, timeout_s=20).body()

    def alarms(self) -> dict[tuple[str, str], Any]:
        """Return the alarms that the DPM lists, by kind and source; empty while it does not run."""
        try:
            items = self.call("alarms")["items"]
        except UnavailableError:
            return {}
        return {(alarm["kind"], alarm["source"]): alarm for alarm in items}

    def kill(self, name: str, number: int) -> None:
        """Send a signal to a process."""
        process = self.supervisor.children[name].process
        assert process is not None
        os.kill(process.pid, number)


@pytest.fixture
def mission(endpoint: str, tmp_path: Path) -> Iterator[Mission]:
    """A running mission."""
    mission = Mission(endpoint, tmp_path)
    with mission.bus:
        yield mission
    mission.stop.set()
    mission.thread.join(20)


def test_alarms_of_the_supervisor_reach_the_dpm_and_stay_acknowledged_over_its_restart(
    mission: Mission, eventually: Eventually
) -> None:
    crash, hung, memory = (
        ("crash_loop", "failing"),
        ("hung_process", "hanging"),
        ("memory_over_budget", "dpm"),
    )
    eventually(lambda: {crash, memory} <= mission.alarms().keys(), 90, "crash loop and memory")
    eventually(lambda: mission.supervisor.children["hanging"].has_beaten, 60, "the first heartbeat")
    mission.kill("hanging", signal.SIGSTOP)
    eventually(lambda: hung in mission.alarms(), 60, "hung process")
    assert mission.call("acknowledge", kind="crash_loop", source="failing")["acknowledged_by"]

    events = [e["kind"] for e in mission.call("history", kind="alarm")["items"]]
    assert events
    mission.kill("dpm", signal.SIGKILL)
    eventually(lambda: not mission.alarms(), 30, "the end of the DPM")
    eventually(lambda: {crash, hung, memory} <= mission.alarms().keys(), 90, "the alarms again")
    alarms = mission.alarms()
    assert alarms[crash]["acknowledged_by"] == "zenoh/operator/ground"
    assert alarms[memory]["acknowledged_by"] is None
