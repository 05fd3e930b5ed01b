# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A fleet for the benchmark of the orchestrator: profiles of many rovers, and light hosts of their DFPCs.

    python benchmarks/_fleet.py --profile FILE --rate-hz RATE

runs the hosts of all DFPCs of a profile in one process. A host answers the life-cycle calls, publishes a
heartbeat each second, and stores a pose in the DPM at each period while ``position_manager`` is active.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.clock import wall_ns
from cdff_common.codecs import encode, encoding_string
from cdff_common.errors import CdffError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.interfaces.profile import Profile, load_profile
from cdff_common.interfaces.registry import Registry
from cdff_common.types import TransformWithCovariance
from cdff_core.orchestration.catalogue import description_of
from cdff_core.orchestration.lifecycle import DFPC_TRANSITIONS

ROOT = Path(__file__).resolve().parents[1]
ROVER = ROOT / "deploy" / "profiles" / "rover_traverse.yaml"


def fleet_profile(robots: int) -> Profile:
    """Return a profile of some rovers with the sensors and DFPCs of the first one of the demonstration.

    No DFPC is always active, so that requests activate them.
    """
    rover = load_profile(ROVER).robots[0]
    entries = [e.model_dump(mode="json", exclude_defaults=True) for e in rover.dfpcs]
    data = rover.model_dump(mode="json", exclude_defaults=True)
    data["dfpcs"] = [{**e, "activation": "on_request", "modes": {}} for e in entries]
    data.pop("urdf", None)
    return Profile.model_validate(
        {"name": "fleet", "robots": [_renamed(data, rover.id, f"r{i}") for i in range(robots)]}
    )


def _renamed(data: Any, old: str, new: str) -> Any:
    """Return plain data in which a robot and its frames have another name."""
    if isinstance(data, dict):
        return {key: _renamed(value, old, new) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_renamed(value, old, new) for value in data]
    if isinstance(data, str) and (data == old or data.startswith(f"{old}/")):
        return new + data[len(old) :]
    return data


class Host:
    """Stand-in of the process of one DFPC."""

    def __init__(self, bus: Bus, robot: Any, entry: Any) -> None:
        self._bus, self.robot, self.name = bus, robot.id, entry.name
        self._description = description_of(robot, entry, Registry.default().dfpc(entry.name))
        self.state, self._changes, self._outputs, self._beats = "inactive", 0, 0, 0
        self._ports = list(entry.inputs)
        for verb in ("configure", "activate", "deactivate", "clean_up"):
            bus.serve(keys.dfpc_rpc(self.robot, self.name, verb), self._on_switch, workers=1)
        bus.serve(keys.dfpc_rpc(self.robot, self.name, "describe"), self._on_describe, workers=1)
        bus.declare_alive(self.robot, self.name)

    def _on_describe(self, _: Request) -> Reply:
        return Reply.of({**self._description, "state": self.state})

    def _on_switch(self, request: Request) -> Reply:
        verb = request.key.rsplit("/", 1)[1]
        self.state = DFPC_TRANSITIONS.get((self.state, verb), self.state)
        self._changes += 1
        return Reply.of({"state": self.state}, changes=self._changes)

    def beat(self) -> None:
        """Publish a heartbeat."""
        body = {"state": self.state, "changes": self._changes, "samples": self._outputs, "rss_mb": 50.0}
        self._beats += 1  # each input has a new sample
        body["samples_by_port"] = dict.fromkeys(self._ports, self._beats)
        body |= {"outputs": self._outputs, "failed": 0, "mean_step_cpu_s": 0.001, "last_step_s": 0.001}
        self._bus.publish_map(keys.dfpc_status(self.robot, self.name), body)

    def store_pose(self, stamp_ns: int) -> None:
        """Store the pose of the robot at a time in the DPM."""
        T = UncertainTransform(se3.transform(np.eye(3), [1.0, 2.0, 0.0]), np.eye(6) * 1e-4)
        child = f"{self.robot}/base"
        value = TransformWithCovariance.from_transform(T, parent="site", child=child, stamp_ns=stamp_ns)
        name = product_id(self.robot, self.name, "pose", stamp_ns, 0, "")
        header = Header(name, 0, stamp_ns, stamp_ns, "site", "fleet/A/1", child=child)
        query = {"robot": self.robot, "dfpc": self.name, "port": "pose", "product": "pose"}
        try:
            self._bus.call(
                keys.dpm_rpc("ground", "put"),
                query,
                payload=encode(value, "uper"),
                encoding=encoding_string("TransformWithCovariance", "uper"),
                attachment=header.to_attachment(),
                timeout_s=30,
            )
            self._outputs += 1
        except CdffError as error:
            print(f"{self.robot}: {error}", file=sys.stderr)


class Unit:
    """Stand-in of the instrument control unit of a robot: each demanded mode is reached at once."""

    def __init__(self, bus: Bus, robot: Any) -> None:
        self._modes = {name: sensor.initial_mode for name, sensor in robot.sensors.items()}
        bus.serve(keys.icu_rpc(robot.id, "modes"), self._on_modes, workers=1)
        bus.serve(keys.icu_rpc(robot.id, "set_mode"), self._on_set_mode, workers=1)
        bus.declare_alive(robot.id, "icu")

    def _on_modes(self, _: Request) -> Reply:
        return Reply.of({"sensors": {s: {"mode": m, "state": "steady"} for s, m in self._modes.items()}})

    def _on_set_mode(self, request: Request) -> Reply:
        mode = self._modes[request.parameters["sensor"]] = request.parameters["mode"]
        return Reply.of({"confirmed": True, "mode": mode})


def run_hosts(profile: Profile, rate_hz: float) -> None:
    """Run the hosts until standard input ends."""
    stop = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), stop.set()), daemon=True).start()
    with Bus.open(name="hosts", wait_s=60) as bus, ThreadPoolExecutor(8) as pool:
        hosts = [Host(bus, robot, entry) for robot in profile.robots for entry in robot.dfpcs]
        for robot in profile.robots:
            Unit(bus, robot)
        bus.declare_alive("ground", "hosts")
        beat_s = time.monotonic()
        while not stop.wait(max(beat_s - time.monotonic(), 0.0)):
            stamp_ns = (wall_ns() - int((time.monotonic() - beat_s) * 1e9)) // 1000 * 1000
            beat_s += 1.0 / rate_hz
            for host in hosts:
                if host.state == "active" and host.name == "position_manager":
                    pool.submit(host.store_pose, stamp_ns)
            for host in hosts:
                host.beat()


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--profile", type=Path, required=True)
    parser.add_argument("--rate-hz", type=float, default=1.0)
    arguments = parser.parse_args()
    run_hosts(load_profile(arguments.profile), arguments.rate_hz)
