# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar SLAM in the host process: sweeps and poses over the bus; the map survives a restart."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.codecs import decode, encode, encoding_string
from cdff_common.geometry import se3
from cdff_common.interfaces.product import Header, Quality, product_id
from cdff_common.types import LidarMap
from tests.integration.conftest import Eventually, Spawn
from tests.support.hills import circle, hills, scan

pytestmark = pytest.mark.integration

NAME, PERIOD_NS, BATCH = "lidar_slam", 500_000_000, 4
WIRING = ["--robot", "mana", "--input", "scan=sensor/lidar/scan"]
DISTANCES_M = np.concatenate([[0.0, 0.0, 0.0, 0.05, 0.2], np.arange(0.5, 14.0, 0.5)])
GROUND = hills(1)


class Sender:
    """Publishes sweeps of a drive along a quarter of a circle, and collects the poses."""

    def __init__(self, bus: Bus, eventually: Eventually) -> None:
        self.bus, self.eventually = bus, eventually
        self.poses: list[Message] = []
        self.true_poses = circle(GROUND, 8.0, DISTANCES_M)
        self._rng = np.random.default_rng(0)
        bus.subscribe(keys.product("mana", NAME, "pose"), self.poses.append, depth=1000)

    def drive(self, begin: int, end: int) -> None:
        """Publish sweeps ``begin`` to ``end`` in batches; wait for the poses of each batch."""
        for first in range(begin, end, BATCH):
            count, last = len(self.poses), min(first + BATCH, end)
            for i in range(first, last):
                self._send(i)
            self.eventually(lambda total=count + last - first: len(self.poses) >= total, timeout_s=60)

    def _send(self, i: int) -> None:
        previous, T = self.true_poses[max(i - 1, 0)], self.true_poses[i]
        start = previous @ se3.exp_se3(0.8 * se3.log_se3(se3.inverse(previous) @ T))
        stamp_ns = (i + 1) * PERIOD_NS
        value = scan(GROUND, start, T, stamp_ns, self._rng)
        identifier = product_id("mana", "lidar", "scan", stamp_ns, i, "")
        header = Header(
            id=identifier,
            seq=i,
            t0_ns=value.t0_ns,
            t1_ns=stamp_ns,
            frame="mana/lidar",
            producer="lidar",
            quality=Quality(),
        )
        self.bus.publish(
            keys.sensor("mana", "lidar", "scan"),
            encode(value, "uper"),
            encoding=encoding_string("LidarScan", "uper"),
            attachment=header.to_attachment(),
        )

    def newest(self) -> np.ndarray:
        """Return the matrix of the newest pose; check its frames."""
        message = self.poses[-1]
        pose = decode("TransformWithCovariance", message.payload, "uper")
        assert (pose.parent_frame, pose.child_frame) == ("mana/slam", "mana/lidar")
        return np.asarray(pose.transform.matrix)


@pytest.mark.req("CDFF-CORE-077")
@pytest.mark.slow
def test_poses_continue_in_the_same_map_after_a_restart(
    router: subprocess.Popen[bytes], spawn: Spawn, endpoint: str, eventually: Eventually, tmp_path: Path
) -> None:
    with Bus.open(endpoint, name="rover", wait_s=10) as bus:
        sender = Sender(bus, eventually)

        def start_host() -> subprocess.Popen[bytes]:
            process = spawn("cdff_common.cli", "dfpc", "run", NAME, *WIRING, "--connect", endpoint)
            alive = keys.alive("mana", NAME)
            eventually(lambda: alive in bus.alive(keys.alive("mana", "*")), timeout_s=90)
            bus.call(keys.dfpc_rpc("mana", NAME, "activate"))
            return process

        process = start_host()
        sender.drive(0, 24)
        process.send_signal(signal.SIGTERM)
        process.wait(120)
        eventually(lambda: not bus.alive(keys.alive("mana", "*")), timeout_s=30)
        assert (tmp_path / "data" / "dfpc" / "mana" / f"{NAME}.state").is_file()
        start_host()
        sender.drive(24, 31)
        first, last = sender.true_poses[0], sender.true_poses[30]
        error = se3.inverse(se3.inverse(first) @ last) @ sender.newest()
        assert np.linalg.norm(error[:3, 3]) < 0.15
        reply = bus.call(f"{keys.dfpc_rpc('mana', NAME, 'call')}/export_map", timeout_s=10)
        decoded = decode("LidarMap", reply.payload, "uper")
        assert isinstance(decoded, LidarMap)
        assert len(decoded.graph.vertices.ids) >= 3
