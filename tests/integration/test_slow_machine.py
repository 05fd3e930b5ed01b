# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar SLAM under its supervisor while its steps exceed their time limit, and after a kill."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.geometry import se3
from services.supervisor.plan import ProcessSpec
from services.supervisor.supervisor import Supervisor
from tests.integration.conftest import Eventually
from tests.integration.test_lidar_slam_host import NAME, Sender

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

STEP_TIMEOUT_S, PERIOD_S = 0.3, 0.2
#: Least time in each period: the step must be on a CPU, or wait for one, for a hundredth of its time limit.
LEAST_RUN_S = 0.008
PROFILE = f"""
name: slow_machine
robots:
- id: mana
  frames:
  - {{parent: mana/base, child: mana/lidar}}
  sensors:
    lidar: {{kind: lidar, frame: mana/lidar, streams: {{scan: LidarScan}}}}
  dfpcs:
  - {{name: lidar_slam, inputs: {{scan: sensor/lidar/scan}}, process: slam, step_timeout_s: {STEP_TIMEOUT_S}}}
"""


@dataclass
class Slowdown:
    """Time of each period in which a process may run."""

    run_s: float = 0.016


@contextmanager
def slowed(pid: int) -> Iterator[Slowdown]:
    """Let a process run for a part of each period only."""
    is_over, slowdown = threading.Event(), Slowdown()

    def work() -> None:
        while not is_over.wait(slowdown.run_s):
            os.kill(pid, signal.SIGSTOP)
            time.sleep(PERIOD_S - slowdown.run_s)
            os.kill(pid, signal.SIGCONT)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield slowdown
    finally:
        is_over.set()
        thread.join()


@pytest.fixture
def supervisor(endpoint: str, tmp_path: Path) -> Iterator[Supervisor]:
    """A running supervisor of a router and a host of lidar SLAM."""
    environment = {
        "CDFF_CONNECT": endpoint,
        "CDFF_LISTEN": endpoint,
        "CDFF_DATA_DIR": str(tmp_path / "data"),
        "OMP_NUM_THREADS": "1",
        "NUMBA_NUM_THREADS": "1",
    }
    profile = tmp_path / "profile.yaml"
    profile.write_text(PROFILE)
    slam = ("-m", "services.dfpc_host", "--profile", str(profile), "--process", "mana_slam")
    specs = [
        ProcessSpec("router", (sys.executable, "-m", "services.router"), environment, ()),
        ProcessSpec("slam", (sys.executable, *slam), environment, ()),
    ]
    supervisor, stop = Supervisor(specs, tmp_path), threading.Event()
    thread = threading.Thread(target=supervisor.run, args=(stop,))
    thread.start()
    yield supervisor
    stop.set()
    thread.join(20)


@pytest.mark.req("CDFF-SUP-041")
def test_a_slow_machine_ends_no_step_and_a_kill_costs_no_map(
    supervisor: Supervisor, endpoint: str, eventually: Eventually
) -> None:
    with Bus.open(endpoint, name="rover", wait_s=60) as bus:
        sender, token = Sender(bus, eventually), keys.alive("mana", NAME)

        def status() -> dict[str, float]:
            body: dict[str, float] = bus.call(keys.dfpc_rpc("mana", NAME, "status"), timeout_s=60).body()
            return body

        def activate() -> int:
            eventually(lambda: token in bus.alive(token), timeout_s=120)
            bus.call(keys.dfpc_rpc("mana", NAME, "activate"), timeout_s=60)
            process = supervisor.children["slam"].process
            assert process is not None
            return process.pid

        first = activate()
        sender.drive(0, 12)
        sent = 12
        with slowed(first) as slowdown:
            while status()["max_step_s"] <= STEP_TIMEOUT_S:
                sender._send(sent)
                sent += 1
                eventually(lambda total=sent: len(sender.poses) >= total, timeout_s=300)
                slowdown.run_s = max(slowdown.run_s / 2, LEAST_RUN_S)
        assert supervisor.children["slam"].restarts == 0
        assert not supervisor.alarms.active()
        sender.drive(sent, 24)

        os.kill(first, signal.SIGKILL)
        eventually(lambda: supervisor.children["slam"].restarts == 1, timeout_s=30)
        eventually(lambda: token not in bus.alive(token), timeout_s=30)
        assert activate() != first
        sender.drive(24, 31)
        first_pose, last_pose = sender.true_poses[0], sender.true_poses[30]
        error = se3.inverse(se3.inverse(first_pose) @ last_pose) @ sender.newest()
        assert np.linalg.norm(error[:3, 3]) < 0.15
