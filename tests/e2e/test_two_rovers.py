# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two rovers share one map although processes die as they drive and one of them is away for a while."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import pack
from cdff_common.clock import NS_PER_S, MissionClock
from cdff_common.errors import UnavailableError
from cdff_common.interfaces.product import Header
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
from tests.integration.relay import Relay

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(400)]

PROFILE = DEPLOY / "profiles" / "two_rovers.yaml"
SHARING = load_script(DEPLOY / "demo" / "two_rovers.yaml").sharing
assert SHARING is not None
#: Mission time: mana is out of contact, its mapping dies meanwhile, all of the drive is over.
CUT_S, DIES_S, RESTORED_S, END_S = 12.0, 18.0, 28.0, 47.0


@pytest.fixture
def log() -> Path:
    return simulated_log(load_scenario("two_rovers"))


@pytest.fixture
def profile() -> Profile:
    return load_profile(PROFILE)


@dataclass(frozen=True, slots=True)
class System:
    """The ground with ``minnie``, ``mana`` on its own router, and the link between them."""

    ground: Stage
    mana: Stage
    link: Relay
    bus: Bus
    aboard: Bus


@pytest.fixture
def system(profile: Profile, tmp_path: Path) -> Iterator[System]:
    port = free_port()
    ground, aboard = f"tcp/127.0.0.1:{port}", f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as opened:
        link = opened.enter_context(Relay(("127.0.0.1", port)))
        uplink = f"tcp/127.0.0.1:{link.port}"
        stages = []
        for endpoint, scopes, up in ((ground, ("ground", "minnie"), ""), (aboard, ("mana",), uplink)):
            http = f"127.0.0.1:{free_port()}"
            stage = Stage(profile, PROFILE, endpoint, http, tmp_path / scopes[0], scopes=scopes, uplink=up)
            stages.append(opened.enter_context(stage))
        buses = [opened.enter_context(Bus.open(end, name="test", wait_s=20)) for end in (ground, aboard)]
        for stage in stages:
            stage.wait_ready(buses[0])
        yield System(*stages, link, *buses)


def until(condition: Callable[[], bool], what: str, deadline_s: float = 180.0) -> None:
    end_s = time.monotonic() + deadline_s
    while not condition():
        assert time.monotonic() < end_s, f"not within {deadline_s:g} s: {what}"
        time.sleep(0.05)


def at(clock: MissionClock, begin_ns: int, seconds: float) -> None:
    until(lambda: clock.now_ns() >= begin_ns + seconds * NS_PER_S, f"mission time {seconds:g} s")


def is_active(bus: Bus, robot: str, dfpc: str) -> bool:
    try:
        return str(bus.call(keys.dfpc_rpc(robot, dfpc, "status"), timeout_s=2).body()["state"]) == "active"
    except UnavailableError:
        return False


def waited_for(bus: Bus, robot: str, dfpc: str, now_ns: int) -> bool:
    """Whether a DFPC is active; where it is not, say for it that it is behind, so that the player holds its clock.

    On a busy machine a process takes as long to start as the whole drive.
    """
    active = is_active(bus, robot, dfpc)
    waits = {"state": "inactive" if active else "active", "oldest_ns": now_ns}
    bus.publish(keys.dfpc_status(robot, f"{dfpc}_awaited"), pack(waits))
    return active


def revisions(bus: Bus, frame: str) -> int:
    asked = {"frame": frame}
    return len(bus.call(keys.dpm_rpc(keys.GROUND, "frames"), asked, timeout_s=60).body()["revisions"])


class Made:
    """What a rover makes for the DPM, as its own router hears it: ids and times of capture."""

    def __init__(self, aboard: Bus, robot: str) -> None:
        self.stamps_ns: dict[str, int] = {}
        for port in ("pose", "graph", "trajectory"):
            aboard.subscribe(keys.product(robot, "lidar_slam", port), self._on_product, depth=4096)
        aboard.subscribe(keys.product(robot, "digital_elevation_mapping", "*"), self._on_product, depth=4096)

    def _on_product(self, message: Message) -> None:
        header = Header.from_attachment(message.attachment)
        if message.payload:
            self.stamps_ns[header.id] = header.t1_ns


def held(bus: Bus, robot: str) -> set[str]:
    """Ids of a robot's products in the DPM."""
    found: set[str] = set()
    asked: dict[str, object] = {"robot": robot, "limit": 500}
    while True:
        page = bus.call(keys.dpm_rpc(keys.GROUND, "search"), asked, timeout_s=60).body()
        found |= {str(item["id"]) for item in page["items"]}
        if page["cursor"] is None:
            return found
        asked["cursor"] = page["cursor"]


def outbox(aboard: Bus, dfpc: str) -> dict[str, Any]:
    return dict(aboard.call(keys.dfpc_rpc("mana", dfpc, "status"), timeout_s=30).body())


@pytest.mark.req("CDFF-SUP-190", "CDFF-SUP-191", "CDFF-SUP-192")
def test_two_rovers_share_one_map_although_processes_die_and_one_rover_is_out_of_contact(
    system: System, profile: Profile, log: Path
) -> None:
    ground, bus = system.ground, system.bus
    made = Made(system.aboard, "mana")
    ground.play(str(log), 1.0, via={"mana": system.mana.connect})
    clock, begin_ns = wait_for_clock(bus, ground.check_running)
    at(clock, begin_ns, 3.0)
    process_of(system.mana, "mana_slam").send_signal(signal.SIGKILL)  # before its first key frame ends
    at(clock, begin_ns, 6.0)
    process_of(ground, "minnie_slam").send_signal(signal.SIGKILL)  # it drives on meanwhile
    at(clock, begin_ns, 8.0)
    for name in ("minnie_mapping", "map_merging"):  # both start again
        process_of(ground, name).send_signal(signal.SIGKILL)
    at(clock, begin_ns, 10.0)
    now_ns = clock.now_ns()
    for robot, dfpc in (("mana", "lidar_slam"), ("minnie", "lidar_slam"), ("minnie", "digital_elevation_mapping")):
        until(partial(waited_for, bus, robot, dfpc, now_ns), f"{dfpc} of {robot} is back")

    at(clock, begin_ns, CUT_S)
    system.link.cut()
    at(clock, begin_ns, DIES_S)
    process_of(system.mana, "mana_mapping").send_signal(signal.SIGKILL)  # its supervisor is the only one to know
    at(clock, begin_ns, RESTORED_S)
    away_ns = [begin_ns + round(t * NS_PER_S) for t in (CUT_S + 1.0, RESTORED_S)]
    made_away = {id_ for id_, stamp_ns in made.stamps_ns.items() if away_ns[0] <= stamp_ns < away_ns[1]}
    assert len(made_away) > 20  # it maps on
    assert not held(bus, "mana") & made_away
    assert outbox(system.aboard, "lidar_slam")["outbox_pending"] > 20
    until(partial(is_active, system.aboard, "mana", "digital_elevation_mapping"), "its mapping goes on by itself")
    system.link.restore()

    until(lambda: revisions(bus, "minnie/slam") > 1, "minnie's map is re-anchored")
    process_of(ground, "map_merging").send_signal(signal.SIGKILL)  # what was merged stays
    at(clock, begin_ns, END_S)
    until(lambda: set(made.stamps_ns) <= held(bus, "mana"), "all that mana made is in the DPM")
    assert all(outbox(system.aboard, d)["outbox_dropped"] == 0 for d in ("lidar_slam", "digital_elevation_mapping"))
    assert settled(SHARING, profile, log, bus, ground.http).faults(SHARING) == []
