# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff top`` and ``/api/v1/status`` show rate, losses and users of a sensor stream, and states of DFPCs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from cdff_common.bus import keys
from cdff_common.cli import main
from cdff_common.client import Client, Sensor
from cdff_common.clock import wall_ns
from cdff_common.errors import CdffError
from cdff_common.types import IMUSensors
from cdff_dev.ports import free_port
from tests.integration.conftest import Eventually, Spawn

pytestmark = pytest.mark.integration

PROFILE = """
name: top
robots:
  - id: mana
    frames: [{parent: site, child: mana/odom}, {parent: mana/base, child: mana/imu}]
    sensors:
      imu:
        kind: imu
        frame: mana/imu
        streams: {sample: IMUSensors}
        modes: {"off": {on: false}, nominal: {rate_hz: 20.0}}
      wheels: {kind: wheels, frame: mana/base, streams: {odometry: TransformWithCovariance}}
    dfpcs:
      - name: position_manager
        activation: always
        inputs: {imu: sensor/imu/sample}
"""


def test_a_driver_with_a_gap_and_a_wrong_rate_is_shown_with_both_faults(
    endpoint: str,
    spawn: Spawn,
    tmp_path: Path,
    eventually: Eventually,
    capsys: pytest.CaptureFixture[str],
) -> None:
    profile, http = tmp_path / "profile.yaml", f"127.0.0.1:{free_port()}"
    profile.write_text(PROFILE)
    spawn("services.router")
    spawn("services.dpm", "--http", http, "--profile", str(profile))
    spawn("services.dfpc_host", "--profile", str(profile), "--robot", "mana", "--dfpc", "position_manager")

    def activate() -> bool:
        try:
            with Client(endpoint) as client:
                client._bus.call(keys.dfpc_rpc("mana", "position_manager", "activate"), timeout_s=5)
        except CdffError:
            return False
        return True

    eventually(activate, timeout_s=90, what="activation")
    rows: dict[str, Any] = {}

    def shown() -> dict[str, Any]:
        capsys.readouterr()
        rows["exit"] = main(["top", "--once", "--json", "--connect", endpoint])
        printed = capsys.readouterr()
        streams = json.loads(printed.out)["streams"] if printed.out else []  # the DPM is still starting
        rows.update({f"{row['sensor']}.{row['stream']}": row for row in streams})
        return rows

    with Sensor("imu/sample", IMUSensors, frame="mana/imu", connect=endpoint, queue=100) as imu:
        t0_ns, count = wall_ns() - 4_000_000_000, 0

        def send(number: int) -> None:
            nonlocal count
            for _ in range(number):
                reading = IMUSensors(acc=np.array([0, 0, 9.81]), gyro=np.zeros(3))
                assert imu.publish(reading, t0_ns + 10_000_000 * count)
                count += 1

        send(8)
        imu._seq += 5  # samples that were lost
        send(8)
        eventually(lambda: shown().get("imu.sample", {}).get("count") == 16, timeout_s=20, what="16 samples")
    row = rows["imu.sample"]
    assert rows["exit"] == 1
    assert row["rate_hz"] == pytest.approx(100.0)
    assert row["faults"][0] == "100 Hz, stated 20 Hz" or row["faults"][0].startswith("silent for")
    assert row["faults"][1] == "5 samples lost in one gap"
    assert row["frame_known"]
    assert row["last"].startswith("specific force 0.00, 0.00, 9.81 m/s²")
    assert row["consumers"] == ["position_manager"]
    assert rows["wheels.odometry"]["consumers"] == []

    with httpx.Client(base_url=f"http://{http}") as web:
        overview = web.get("/api/v1/status").json()["overview"]
        page = web.get("/").text
    assert [r["sensor"] for r in overview["streams"]] == ["imu", "wheels"]
    assert overview["streams"][0]["lost"] == 5
    assert overview["dfpcs"][0]["state"] == "active"
    assert 'id="streams"' in page
    assert main(["top", "--once", "--connect", endpoint]) == 1
    assert "mana/imu.sample" in capsys.readouterr().out
