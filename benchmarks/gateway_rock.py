# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Samples per second through the gateway to ROCK, compared with reads of the same port over CORBA alone.

    python benchmarks/gateway_rock.py [--out FILE] [--seconds S]

Router, gateway, name service and a task by omniORB (Python) are processes; ``make peers`` installs omniORB.
The task sends ``/base/samples/RigidBodyState`` (1.1 kB) whenever it is asked. ``raw`` reads it without the
gateway.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from _report import write_report
from _services import Services

from cdff_common.bus import Bus, keys
from cdff_dev.ports import free_port
from services.corba.giop import Connections
from services.corba.naming import NameService
from services.gateway_rock.tasks import Task

ROOT = Path(__file__).resolve().parents[1]
PEERS, TESTS = ROOT / "build" / "rock-peers" / "bin", ROOT / "tests" / "integration"
TYPE = "/base/samples/RigidBodyState"
SETTINGS = f"""robot: mana
frames: {{body: mana/base, map: mana/odom}}
inputs:
  - {{task: sensor_task, port: pose, type: {TYPE}, stream: wheels/pose, frame: mana/odom, child: mana/base,
     max_hz: 100000, poll_hz: 10000}}
"""


def pose() -> dict[str, Any]:
    """Return a pose as plain data."""
    matrix, vector = {"data": list(np.eye(3).ravel())}, {"data": [1.0, 2.0, 3.0]}
    return {
        "time": {"microseconds": 0},
        "sourceFrame": "body",
        "targetFrame": "map",
        "position": vector,
        "cov_position": matrix,
        "orientation": {"im": [0.0, 0.0, 0.0], "re": 1.0},
        "cov_orientation": matrix,
        "velocity": vector,
        "cov_velocity": matrix,
        "angular_velocity": vector,
        "cov_angular_velocity": matrix,
    }


def raw_hz(names_port: int, seconds: float) -> float:
    """Return reads per second of a port without the gateway."""
    connections = Connections()
    reader = Task(NameService("127.0.0.1", names_port, connections), "sensor_task").reader("pose", 100)
    count, start_s = 0, time.perf_counter()
    while time.perf_counter() - start_s < seconds:
        count += reader.read() is not None
    elapsed_s = time.perf_counter() - start_s
    connections.close()
    return count / elapsed_s


def gateway_hz(endpoint: str, seconds: float) -> float:
    """Return samples per second on the bus."""
    counted = [0]

    def count(_: object) -> None:
        counted[0] += 1

    with Bus.open(endpoint, name="benchmark", wait_s=20.0) as bus:
        bus.subscribe(keys.sensor("mana", "wheels", "pose"), count, depth=10_000)
        while not counted[0]:
            time.sleep(0.05)
        first, start_s = counted[0], time.perf_counter()
        time.sleep(seconds)
        return (counted[0] - first) / (time.perf_counter() - start_s)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path)
    parser.add_argument("--seconds", type=float, default=5.0)
    args = parser.parse_args()
    names_port = free_port()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        values = {"pose": {"type": TYPE, "idl": "RigidBodyState", "values": [pose()]}}
        values["pose"] |= {"repeat": True, "stamp_now": True}
        (folder / "values.json").write_text(json.dumps(values), encoding="utf-8")
        (folder / "gateway.yaml").write_text(SETTINGS, encoding="utf-8")
        (folder / "names").mkdir()
        endpoint = f"giop:tcp:127.0.0.1:{names_port}"
        server = [PEERS / "omniNames", "-start", str(names_port), "-logdir", folder / "names"]
        task = [PEERS / "python", TESTS / "rock_servant.py", TESTS / "rock", str(names_port)]
        task += [folder / "values.json", folder / "received.json"]
        with (
            subprocess.Popen(
                [*server, "-ORBendPoint", endpoint], stderr=subprocess.DEVNULL, start_new_session=True
            ) as name_service,
            subprocess.Popen(task, stdout=subprocess.PIPE) as servant,
            Services(folder, with_dpm=False) as services,
        ):
            assert servant.stdout is not None
            servant.stdout.readline()
            raw = raw_hz(names_port, args.seconds)
            command = [sys.executable, "-m", "services.gateway_rock", "--settings", folder / "gateway.yaml"]
            command += ["--connect", services.endpoint, "--names", f"127.0.0.1:{names_port}"]
            with subprocess.Popen(command, stderr=subprocess.DEVNULL) as gateway:
                try:
                    through = gateway_hz(services.endpoint, args.seconds)
                finally:
                    for process in (gateway, servant):
                        process.terminate()
                    os.killpg(name_service.pid, signal.SIGKILL)  # a script that starts the program
    report = {"raw_hz": round(raw), "gateway_hz": round(through), "load": round(os.getloadavg()[0], 1)}
    write_report({"seconds": args.seconds, **report}, args.out)


if __name__ == "__main__":
    main()
