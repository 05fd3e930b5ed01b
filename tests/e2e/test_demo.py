# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff demo`` in a process of its own; sensors are on only while a DFPC uses them."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import on_map
from cdff_common.interfaces.profile import Profile, load_profile
from cdff_dev.ports import free_port
from tests.integration.conftest import ROOT

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(400)]


PROFILE = load_profile("rover_traverse")
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


def demo(*arguments: str) -> subprocess.Popen[str]:
    addresses = ["--connect", f"tcp/127.0.0.1:{free_port()}", "--http", f"127.0.0.1:{free_port()}"]
    return subprocess.Popen(  # a later --connect replaces an earlier one
        [sys.executable, "-m", "cdff_common.cli", "demo", *addresses, *arguments],
        cwd=ROOT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )


@dataclass(frozen=True, slots=True)
class Demonstration:
    """A demonstration that has sent all its requests and still runs; ``output`` are its lines so far."""

    process: subprocess.Popen[str]
    output: str
    bus: Bus
    watch: SensorWatch
    data_dir: Path


@pytest.fixture(scope="module")
def demonstration(traverse: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Demonstration]:
    """The demonstration on the simulated traverse, from its start to Ctrl-C of the last test."""
    endpoint, lines = f"tcp/127.0.0.1:{free_port()}", []
    data_dir = tmp_path_factory.mktemp("demonstration") / "data"
    with demo(
        "--connect", endpoint, "--data-dir", str(data_dir)
    ) as process:  # closes the pipe and waits, also after a failure
        try:
            assert process.stdout is not None
            with Bus.open(endpoint, name="test", wait_s=120) as bus:
                watch = SensorWatch(bus, PROFILE)
                for line in process.stdout:
                    lines.append(line)
                    if line.startswith("browse http"):
                        break
                yield Demonstration(process, "".join(lines), bus, watch, data_dir)
        finally:
            process.kill()


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-028")
def test_every_request_of_the_simulated_traverse_is_satisfied(demonstration: Demonstration) -> None:
    assert re.search(r"(\d+) of \1 ready", demonstration.output)
    assert "8 of 8 requests were answered as asked" in demonstration.output


@pytest.mark.slow
def test_the_payloads_of_the_demonstration_are_stored_compressed(demonstration: Demonstration) -> None:
    """A map of 9.3 MB, of which 16 to 19 % is observed, becomes 1.3 MB on average."""
    folders = (demonstration.data_dir / "blobs", demonstration.data_dir / "packs")
    sizes = [file.stat().st_size for folder in folders for file in folder.rglob("*") if file.is_file()]
    maps = [size for size in sizes if size > 1_000_000]
    print(
        f"payloads {sum(sizes) / 1e6:.1f} MB; {len(maps)} maps of {sum(maps) / len(maps) / 1e6:.2f} MB each"
    )
    assert sum(sizes) < 40_000_000
    assert sum(maps) / len(maps) < 1_500_000


@pytest.mark.slow
def test_a_lidar_is_off_soon_after_its_last_user(demonstration: Demonstration) -> None:
    watch, linger_s = demonstration.watch, max(e.linger_s for r in PROFILE.robots for e in r.dfpcs)
    assert watch.wait_until_off(linger_s + RELEASE_S), f"on: {watch.on}, used: {watch.used}"
    for robot in PROFILE.robot_ids:
        modes = demonstration.bus.call(keys.icu_rpc(robot, "modes"), timeout_s=10).body()
        assert modes["sensors"]["lidar"]["mode"] == "off"
    for robot, times in watch.on.items():
        uses = list(zip(watch.used[robot][::2], watch.used[robot][1::2], strict=True))
        intervals = list(zip(times[::2], times[1::2], strict=True))
        assert intervals, f"the lidar of {robot} was used"
        for start_s, end_s in intervals:
            last_use_s = max((end for begin, end in uses if begin < end_s), default=start_s)
            assert end_s - last_use_s <= RELEASE_S, f"{robot}: on {times}, used {uses}"


@pytest.mark.slow
def test_ctrl_c_ends_every_process_within_five_seconds(demonstration: Demonstration) -> None:
    process = demonstration.process
    demonstration.bus.close()
    processes = psutil.Process(process.pid).children(recursive=True)
    assert len(processes) > 8
    process.send_signal(signal.SIGINT)
    assert process.wait(5.0) == 0  # every request was satisfied
    survivors = [p for p in processes if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]
    assert not survivors, [p.cmdline() for p in survivors]


@pytest.mark.slow
def test_the_demonstration_answers_every_request_on_a_recorded_drive(
    real_data: Callable[[str], Path],
) -> None:
    process = demo("--once", "--log", str(real_data("kitti_stereo/KITTI_sequence_1")))
    output, _ = process.communicate(timeout=380)
    assert process.returncode == 0, output
    assert "4 of 4 requests were answered as asked" in output


def test_an_address_in_use_is_reported_as_an_error() -> None:
    import socket

    with socket.socket() as used_socket:
        used_socket.bind(("127.0.0.1", 0))
        used_socket.listen()
        process = subprocess.run(
            [
                sys.executable,
                "-m",
                "cdff_common.cli",
                "demo",
                "--once",
                "--http",
                f"127.0.0.1:{used_socket.getsockname()[1]}",
                "--connect",
                f"tcp/127.0.0.1:{free_port()}",
            ],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
    assert process.returncode == 1
    assert "is in use" in process.stderr
