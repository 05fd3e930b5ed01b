# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff dfpc run NAME --robot ID`` needs only the wiring and the router's endpoint."""

from __future__ import annotations

import subprocess

from cdff_common.bus import Bus, keys
from tests.integration.conftest import Eventually, Spawn


def test_a_dfpc_runs_as_a_service_without_a_profile(
    router: subprocess.Popen[bytes], spawn: Spawn, endpoint: str, eventually: Eventually
) -> None:
    wiring = ["--input", "odometry=sensor/wheels/odometry", "--connect", endpoint]
    spawn("cdff_common.cli", "dfpc", "run", "position_manager", "--robot", "scout", *wiring)
    with Bus.open(endpoint, name="test", wait_s=10) as bus:
        alive = keys.alive("scout", "position_manager")
        eventually(lambda: alive in bus.alive(keys.alive("scout", "*")), timeout_s=30)
        answer = bus.call(keys.dfpc_rpc("scout", "position_manager", "activate")).body()
        assert answer["state"] == "active"
