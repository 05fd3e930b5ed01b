# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two rovers share one map although processes are killed during the drive and one rover loses contact."""

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
from cdff_common.clock import NS_PER_S
from cdff_common.errors import UnavailableError
from cdff_common.interfaces.product import Header
from cdff_common.interfaces.profile import Profile, load_profile
from cdff_common.mission_clock import MissionClock
from cdff_common.resources import deploy_folder
from cdff_dev.missions.map_sharing import assess_shared_map
from cdff_dev.missions.requests import wait_for_clock
from cdff_dev.missions.script import load_script
from cdff_dev.missions.stage import Stage
from cdff_dev.ports import free_port
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.store import simulated_log
from tests.e2e.conftest import process_of
from tests.support.relay import Relay

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(400)]

PROFILE = deploy_folder() / "profiles" / "two_rovers.yaml"
SHARING = load_script(deploy_folder() / "demo" / "two_rovers.yaml").sharing
assert SHARING is not None
#: Mission times at which mana loses contact, its mapping is killed, contact is restored, the drive ends.
CUT_S, MAPPING_KILLED_S, RESTORED_S, END_S = 12.0, 18.0, 28.0, 47.0


@pytest.fixture
def log() -> Path:
    return simulated_log(load_scenario("two_rovers"))


@pytest.fixture
def profile() -> Profile:
    return load_profile(PROFILE)


@dataclass(frozen=True, slots=True)
class System:
    """The ground and ``minnie`` on one router, ``mana`` on a second router, and the link between the two."""

    ground: Stage
    mana: Stage
    link: Relay
    bus: Bus
    mana_bus: Bus


@pytest.fixture
def system(profile: Profile, tmp_path: Path) -> Iterator[System]:
    port = free_port()
    ground_endpoint, mana_endpoint = f"tcp/127.0.0.1:{port}", f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        link = stack.enter_context(Relay(("127.0.0.1", port)))
        uplink = f"tcp/127.0.0.1:{link.port}"
        stages = []
        for endpoint, scopes, stage_uplink in (
            (ground_endpoint, ("ground", "minnie"), ""),
            (mana_endpoint, ("mana",), uplink),
        ):
            http = f"127.0.0.1:{free_port()}"
            stage = Stage(
                profile, PROFILE, endpoint, http, tmp_path / scopes[0], scopes=scopes, uplink=stage_uplink
            )
            stages.append(stack.enter_context(stage))
        buses = [
            stack.enter_context(Bus.open(endpoint, name="test", wait_s=20))
            for endpoint in (ground_endpoint, mana_endpoint)
        ]
        for stage in stages:
            stage.wait_ready(buses[0])
        yield System(*stages, link, *buses)


def wait_until(condition: Callable[[], bool], description: str, timeout_s: float = 180.0) -> None:
    end_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end_s, f"not within {timeout_s:g} s: {description}"
        time.sleep(0.05)


def wait_for_mission_time(clock: MissionClock, start_ns: int, seconds: float) -> None:
    wait_until(lambda: clock.now_ns() >= start_ns + seconds * NS_PER_S, f"mission time {seconds:g} s")


def is_active(bus: Bus, robot: str, dfpc: str) -> bool:
    try:
        return str(bus.call(keys.dfpc_rpc(robot, dfpc, "status"), timeout_s=2).body()["state"]) == "active"
    except UnavailableError:
        return False


def is_active_or_player_held(bus: Bus, robot: str, dfpc: str, now_ns: int) -> bool:
    """Return whether a DFPC is active; publish a backlog while it is not, so that the player pauses.

    Without the pause, a process on a busy machine may take as long to start as the whole drive.
    """
    has_started = is_active(bus, robot, dfpc)
    status = {"state": "inactive" if has_started else "active", "oldest_ns": now_ns}
    bus.publish(keys.dfpc_status(robot, f"{dfpc}_awaited"), pack(status))
    return has_started


def revision_count(bus: Bus, frame: str) -> int:
    parameters = {"frame": frame}
    return len(bus.call(keys.dpm_rpc(keys.GROUND, "frames"), parameters, timeout_s=60).body()["revisions"])


class ProductRecorder:
    """Records id and capture time of the products that a rover publishes on its own router."""

    def __init__(self, mana_bus: Bus, robot: str) -> None:
        self.stamps_ns: dict[str, int] = {}
        for port in ("pose", "graph", "trajectory"):
            mana_bus.subscribe(keys.product(robot, "lidar_slam", port), self._on_product, depth=4096)
        mana_bus.subscribe(
            keys.product(robot, "digital_elevation_mapping", "*"), self._on_product, depth=4096
        )

    def _on_product(self, message: Message) -> None:
        header = Header.from_attachment(message.attachment)
        if message.payload:
            self.stamps_ns[header.id] = header.t1_ns


def stored_ids(bus: Bus, robot: str) -> set[str]:
    """Return the ids of a robot's products in the DPM."""
    ids: set[str] = set()
    parameters: dict[str, object] = {"robot": robot, "limit": 500}
    while True:
        page = bus.call(keys.dpm_rpc(keys.GROUND, "search"), parameters, timeout_s=60).body()
        ids |= {str(item["id"]) for item in page["items"]}
        if page["cursor"] is None:
            return ids
        parameters["cursor"] = page["cursor"]


def dfpc_status(mana_bus: Bus, dfpc: str) -> dict[str, Any]:
    return dict(mana_bus.call(keys.dfpc_rpc("mana", dfpc, "status"), timeout_s=30).body())


@pytest.mark.req("CDFF-SUP-190", "CDFF-SUP-191", "CDFF-SUP-192")
def test_two_rovers_share_one_map_despite_killed_processes_and_lost_contact(
    system: System, profile: Profile, log: Path
) -> None:
    ground, bus = system.ground, system.bus
    products = ProductRecorder(system.mana_bus, "mana")
    ground.play(str(log), 1.0, via={"mana": system.mana.connect})
    clock, start_ns = wait_for_clock(bus, ground.check_running)
    wait_for_mission_time(clock, start_ns, 3.0)
    process_of(system.mana, "mana_slam").send_signal(signal.SIGKILL)  # before the first keyframe
    wait_for_mission_time(clock, start_ns, 6.0)
    process_of(ground, "minnie_slam").send_signal(signal.SIGKILL)  # the rover keeps driving
    wait_for_mission_time(clock, start_ns, 8.0)
    for name in ("minnie_mapping", "map_merging"):  # the supervisor restarts both
        process_of(ground, name).send_signal(signal.SIGKILL)
    wait_for_mission_time(clock, start_ns, 10.0)
    now_ns = clock.now_ns()
    for robot, dfpc in (
        ("mana", "lidar_slam"),
        ("minnie", "lidar_slam"),
        ("minnie", "digital_elevation_mapping"),
    ):
        wait_until(partial(is_active_or_player_held, bus, robot, dfpc, now_ns), f"{dfpc} of {robot} is back")

    wait_for_mission_time(clock, start_ns, CUT_S)
    system.link.cut()
    wait_for_mission_time(clock, start_ns, MAPPING_KILLED_S)
    # Without contact, only the supervisor of mana can restart its mapping.
    process_of(system.mana, "mana_mapping").send_signal(signal.SIGKILL)
    wait_for_mission_time(clock, start_ns, RESTORED_S)
    no_contact_ns = [start_ns + round(t * NS_PER_S) for t in (CUT_S + 1.0, RESTORED_S)]
    ids_without_contact = {
        id_ for id_, stamp_ns in products.stamps_ns.items() if no_contact_ns[0] <= stamp_ns < no_contact_ns[1]
    }
    assert len(ids_without_contact) > 8  # mana keeps mapping; how fast depends on the machine
    assert not stored_ids(bus, "mana") & ids_without_contact
    assert dfpc_status(system.mana_bus, "lidar_slam")["outbox_pending"] > 8
    wait_until(
        partial(is_active, system.mana_bus, "mana", "digital_elevation_mapping"),
        "mana's mapping restarts without contact",
    )
    system.link.restore()

    wait_until(lambda: revision_count(bus, "minnie/slam") > 1, "minnie's map is re-anchored")
    process_of(ground, "map_merging").send_signal(signal.SIGKILL)  # the merged map is kept
    wait_for_mission_time(clock, start_ns, END_S)
    wait_until(
        lambda: set(products.stamps_ns) <= stored_ids(bus, "mana"), "all products of mana are in the DPM"
    )
    assert all(
        dfpc_status(system.mana_bus, d)["outbox_dropped"] == 0
        for d in ("lidar_slam", "digital_elevation_mapping")
    )
    assert assess_shared_map(SHARING, profile, log, bus, ground.http).faults(SHARING) == []
