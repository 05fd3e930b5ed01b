# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensors of the demonstration are on only while a DFPC uses them, watched over the whole run."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import on_map
from cdff_common.interfaces.profile import Profile, load_profile
from cdff_common.resources import deploy_folder
from cdff_dev.missions.demonstration import demonstrate, script_of
from cdff_dev.missions.stage import Stage
from cdff_dev.ports import free_port

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(600)]

#: Time between the deactivation of the last user and the confirmed mode off, seconds, on a busy machine.
RELEASE_S = 10.0


class SensorWatch:
    """Intervals in which each lidar is on, and those in which a DFPC that uses it is active.

    Attributes
    ----------
    on, used : dict of str to list of float
        Monotonic times, seconds, at which the lidar of a robot is switched on and off in turn, and at which
        its users begin and end.
    """

    def __init__(self, bus: Bus, profile: Profile) -> None:
        self.on: dict[str, list[float]] = {robot: [] for robot in profile.robot_ids}
        self.used: dict[str, list[float]] = {robot: [] for robot in profile.robot_ids}
        self._users = {
            (r.id, entry.name) for r in profile.robots for entry in r.dfpcs if "lidar" in entry.modes
        }
        self._changed = threading.Condition()
        bus.subscribe(keys.event("*", "sensor_mode"), on_map(self._on_mode), depth=1024)
        for kind in ("activated", "deactivated"):
            bus.subscribe(keys.event("*", kind), on_map(self._on_activation), depth=1024)

    def wait_until_off(self, timeout_s: float) -> bool:
        """Wait until all lidars are off and unused; return False if they are not in time."""
        with self._changed:
            return self._changed.wait_for(
                lambda: all(len(times) % 2 == 0 for times in (*self.on.values(), *self.used.values())),
                timeout_s,
            )

    def _on_mode(self, key: str, body: dict[str, Any]) -> None:
        if body["sensor"] == "lidar":
            self._set(self.on[key.split("/")[2]], body["mode"] != "off")

    def _on_activation(self, key: str, body: dict[str, Any]) -> None:
        robot, kind = key.split("/")[2], key.rsplit("/", 1)[1]
        if (robot, body["dfpc"]) in self._users:
            self._set(self.used[robot], kind == "activated")

    def _set(self, times: list[float], is_on: bool) -> None:
        with self._changed:
            if is_on != bool(len(times) % 2):
                times.append(time.monotonic())
                self._changed.notify_all()


def test_a_lidar_is_off_soon_after_its_last_user(traverse: Path) -> None:
    path = deploy_folder() / "profiles" / "rover_traverse.yaml"
    profile, script = load_profile(path), script_of("rover_traverse")
    endpoint, http = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    linger_s = max(entry.linger_s for robot in profile.robots for entry in robot.dfpcs)
    with Stage(profile, path, endpoint, http) as stage, Bus.open(endpoint, name="test", wait_s=60) as bus:
        stage.wait_ready(bus)
        watch = SensorWatch(bus, profile)
        demonstrate("rover_traverse", script, traverse, stage, bus, None, print)  # its answers: test_demo
        assert watch.wait_until_off(linger_s + RELEASE_S), f"on: {watch.on}, used: {watch.used}"
        for robot in profile.robot_ids:
            mode = bus.call(keys.icu_rpc(robot, "modes"), timeout_s=10).body()["sensors"]["lidar"]["mode"]
            assert mode == "off"
    for robot, times in watch.on.items():
        uses = list(zip(watch.used[robot][::2], watch.used[robot][1::2], strict=True))
        intervals = list(zip(times[::2], times[1::2], strict=True))
        assert intervals, f"the lidar of {robot} was used"
        for start_s, end_s in intervals:
            last_use_s = max((end for begin, end in uses if begin < end_s), default=start_s)
            assert end_s - last_use_s <= RELEASE_S, f"{robot}: on {times}, used {uses}"
