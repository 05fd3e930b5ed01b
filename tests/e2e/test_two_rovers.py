# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two rovers share one map although processes die as they drive and one of them is away for a while."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.clock import NS_PER_S, MissionClock
from cdff_common.errors import UnavailableError
from cdff_common.interfaces.profile import Profile, load_profile
from cdff_dev.demo.commands import DEPLOY
from cdff_dev.demo.run import wait_for_clock
from cdff_dev.demo.script import load_script
from cdff_dev.demo.sharing import settled
from cdff_dev.demo.stage import Stage
from cdff_dev.ports import free_port
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.store import simulated_log
from tests.e2e.conftest import process_of

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(400)]

PROFILE = DEPLOY / "profiles" / "two_rovers.yaml"
SHARING = load_script(DEPLOY / "demo" / "two_rovers.yaml").sharing
assert SHARING is not None
#: All of the drive.
END_S = 47.0


@pytest.fixture
def log() -> Path:
    return simulated_log(load_scenario("two_rovers"))


@pytest.fixture
def profile() -> Profile:
    return load_profile(PROFILE)


@pytest.fixture
def system(profile: Profile, tmp_path: Path) -> Iterator[tuple[Stage, Bus]]:
    endpoint, http = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    with Stage(profile, PROFILE, endpoint, http, tmp_path) as stage, Bus.open(endpoint, name="test", wait_s=20) as bus:
        stage.wait_ready(bus)
        yield stage, bus


def until(condition: Callable[[], bool], what: str, deadline_s: float = 180.0) -> None:
    end_s = time.monotonic() + deadline_s
    while not condition():
        assert time.monotonic() < end_s, f"not within {deadline_s:g} s: {what}"
        time.sleep(0.05)


def at(clock: MissionClock, begin_ns: int, seconds: float) -> None:
    until(lambda: clock.now_ns() >= begin_ns + seconds * NS_PER_S, f"mission time {seconds:g} s")


def waited_for(bus: Bus, robot: str, dfpc: str, now_ns: int) -> bool:
    """Whether a DFPC is active; where it is not, say for it that it is behind, so that the player holds its clock.

    On a busy machine a process takes as long to start as the whole drive.
    """
    try:
        active = str(bus.call(keys.dfpc_rpc(robot, dfpc, "status"), timeout_s=2).body()["state"]) == "active"
    except UnavailableError:
        active = False
    waits = {"state": "inactive" if active else "active", "oldest_ns": now_ns}
    bus.publish(keys.dfpc_status(robot, f"{dfpc}_awaited"), pack(waits))
    return active


def revisions(bus: Bus, frame: str) -> int:
    asked = {"frame": frame}
    return len(bus.call(keys.dpm_rpc(keys.GROUND, "frames"), asked, timeout_s=60).body()["revisions"])


@pytest.mark.req("CDFF-SUP-190", "CDFF-SUP-191", "CDFF-SUP-192")
def test_two_rovers_share_one_map_although_processes_die_and_one_rover_is_out_of_contact(
    system: tuple[Stage, Bus], profile: Profile, log: Path
) -> None:
    stage, bus = system
    stage.play(str(log), 1.0)
    clock, begin_ns = wait_for_clock(bus, stage.check_running)
    at(clock, begin_ns, 3.0)
    process_of(stage, "mana_slam").send_signal(signal.SIGKILL)  # as it begins to drive, before its first key frame ends
    at(clock, begin_ns, 6.0)
    process_of(stage, "minnie_slam").send_signal(signal.SIGKILL)  # it drives on meanwhile
    at(clock, begin_ns, 8.0)
    for name in ("minnie_mapping", "map_merging"):  # both start again
        process_of(stage, name).send_signal(signal.SIGKILL)
    at(clock, begin_ns, 10.0)
    now_ns = clock.now_ns()
    for robot, dfpc in (("mana", "lidar_slam"), ("minnie", "lidar_slam"), ("minnie", "digital_elevation_mapping")):
        until(partial(waited_for, bus, robot, dfpc, now_ns), f"{dfpc} of {robot} is back")
    at(clock, begin_ns, 22.0)
    away = [process_of(stage, name) for name in ("mana_slam", "mana_mapping")]
    for process in away:
        process.send_signal(signal.SIGSTOP)
    at(clock, begin_ns, 24.0)
    for process in away:
        process.send_signal(signal.SIGCONT)
    until(lambda: revisions(bus, "minnie/slam") > 1, "minnie's map is re-anchored")
    process_of(stage, "map_merging").send_signal(signal.SIGKILL)  # what was merged stays
    at(clock, begin_ns, END_S)
    assert settled(SHARING, profile, log, bus, stage.http).faults(SHARING) == []
