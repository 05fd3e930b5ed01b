# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A DPM on a full disk, without its database, and with a wrong mission clock."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.clock import NS_PER_S, wall_ns
from cdff_common.codecs import encode, encoding_string
from cdff_common.errors import CdffError
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import Pointcloud
from cdff_dev.ports import free_port

from .conftest import Eventually, Spawn, fill_disk

pytestmark = pytest.mark.slow

PROFILE = """
name: durability
robots:
- id: mana
  frames: [{parent: mana/base, child: mana/lidar, translation_m: [0.0, 0.0, 2.0]}]
"""


class System:
    """A router, a DPM and a bus to call it."""

    def __init__(self, spawn: Spawn, eventually: Eventually, endpoint: str, folder: Path) -> None:
        self._spawn, self._eventually, self.folder = spawn, eventually, folder
        self._profile = folder / "profile.yaml"
        self._profile.write_text(PROFILE)
        self._address = f"127.0.0.1:{free_port()}"
        spawn("services.router")
        self.bus = Bus.open(endpoint, name="test", wait_s=60)

    def start(self, *options: str) -> subprocess.Popen[bytes]:
        """Start the DPM without waiting for it."""
        return self._spawn("services.dpm", "--profile", str(self._profile), "--http", self._address, *options)

    def wait(self) -> None:
        """Wait until the DPM answers."""
        self._eventually(lambda: len(self.bus.alive(keys.alive("*", "dpm"))) == 2, 90, "the DPM's tokens")

    def end(self, process: subprocess.Popen[bytes]) -> None:
        """Kill the DPM and wait until its tokens have disappeared."""
        process.send_signal(signal.SIGKILL)
        process.wait()
        self._eventually(lambda: not self.bus.alive(keys.alive("*", "dpm")), 30, "the end of the tokens")

    def put(self, seq: int, points: int = 3000) -> str:
        """Insert a cloud; return its id once it is durable."""
        cloud = np.random.default_rng(seq).normal(0.0, 2.0, (points, 3))
        product = product_id("mana", "test", "pointcloud", seq * NS_PER_S, seq, "c")
        header = Header(product, seq, seq * NS_PER_S, seq * NS_PER_S, "site", "test", config_hash="c")
        self.bus.call(
            keys.dpm_rpc("mana", "put"),
            {"dfpc": "test", "port": "pointcloud", "product": "pointcloud"},
            payload=encode(Pointcloud.from_points(cloud, frame="site", stamp_ns=seq * NS_PER_S), "uper"),
            encoding=encoding_string("Pointcloud", "uper"),
            attachment=header.to_attachment(),
            timeout_s=30,
        )
        return product

    def call(self, verb: str, **parameters: object) -> dict[str, object]:
        """Call ``dpm/@rpc/{verb}`` under ``ground``."""
        body: dict[str, object] = self.bus.call(keys.dpm_rpc("ground", verb), parameters, timeout_s=30).body()
        return body

    def text(self, path: str) -> str:
        """Return what the HTTP server serves at a path."""
        with urllib.request.urlopen(f"http://{self._address}{path}", timeout=30) as answer:
            return str(answer.read().decode())


@pytest.fixture
def system(spawn: Spawn, eventually: Eventually, endpoint: str, tmp_path: Path) -> Iterator[System]:
    """A router and the commands for a DPM."""
    system = System(spawn, eventually, endpoint, tmp_path)
    with system.bus:
        yield system


def test_a_dpm_reports_a_missing_database_before_it_finds_a_router(spawn: Spawn, tmp_path: Path) -> None:
    (tmp_path / "data" / "packs").mkdir(parents=True)
    (tmp_path / "data" / "packs" / "0.pack").write_bytes(b"payloads of an earlier database")
    process = spawn("services.dpm", "--http", f"127.0.0.1:{free_port()}")
    assert process.wait(60) == 1
    assert "cdff dpm rebuild" in (tmp_path / "services.dpm.log").read_text()


def test_a_dpm_that_starts_on_a_full_disk_serves_and_deletes_and_refuses_products(
    small_disk: Path, system: System
) -> None:
    process = system.start()
    system.wait()
    products = [system.put(seq) for seq in range(3)]
    system.end(process)
    ballast = fill_disk(small_disk)
    system.start()
    system.wait()
    assert system.call("search", type="pointcloud", limit=10)["items"]
    assert system.bus.call(keys.dpm_product("mana", products[0]), timeout_s=30).payload
    with pytest.raises(CdffError, match="not stored"):
        system.put(10)
    assert "disk_full of dpm: " in system.text("/readyz")
    metrics = system.text("/metrics")
    assert 'cdff_alarm{kind="disk_full",source="dpm",severity="critical",acknowledged="false"} 1' in metrics
    assert 'cdff_dpm_operations_total{operation="refused"} 1' in metrics
    assert system.call("delete", id=products[1])["deleted"] is True
    ballast.unlink()
    assert system.put(10)
    assert system.text("/readyz") == "ready\n"


def test_a_missing_database_costs_no_product(system: System) -> None:
    process = system.start()
    system.wait()
    products = [system.put(seq) for seq in range(3)]
    system.end(process)
    data = system.folder / "data"
    for path in data.glob("store.sqlite*"):
        path.unlink()
    assert system.start().wait(60) == 1
    assert "cdff dpm rebuild" in (system.folder / "services.dpm.log").read_text()
    command = [sys.executable, "-m", "cdff_common.cli", "dpm", "rebuild", "--data-dir", str(data)]
    rebuilt = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "3 products" in rebuilt.stdout
    system.start()
    system.wait()
    assert system.bus.call(keys.dpm_product("mana", products[0]), timeout_s=30).payload


def test_wrong_clock_messages_change_nothing(system: System) -> None:
    system.start()
    system.wait()
    wrong = [(wall_ns(), math.inf), (wall_ns(), math.nan), (1 << 62, 1.0), (math.inf, 1.0), ("now", None)]
    for _ in range(3):
        for now_ns, rate in wrong:
            system.bus.publish_map(keys.CLOCK, {"now_ns": now_ns, "rate": rate})
        now_ns = system.call("stat")["now_ns"]
        assert isinstance(now_ns, int)
        assert abs(now_ns - wall_ns()) < 60 * NS_PER_S
    assert system.put(1)
