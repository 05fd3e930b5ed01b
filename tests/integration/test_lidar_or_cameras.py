# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Choice between lidar and visual compounds by the orchestrator, with real processes and both sensors."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import unpack
from cdff_common.client import Client
from cdff_common.clock import wall_ns
from cdff_common.codecs import encode_payload
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import FramePair
from cdff_dev.ports import free_port
from tests.integration.conftest import process_starter
from tests.integration.conftest import wait_until as eventually
from tests.support import textured_walls as walls
from tests.support.hills import hills, pose_on_ground, scan

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "lidar_or_cameras.yaml")
PERIOD_S = 1.0
POSE: dict[str, Any] = {"robot": "mana", "frame": "site", "max_age_s": 4.0, "deadline_s": 90}


class Rover:
    """A rover at rest whose lidar and stereo camera send samples while the ICU reports them as on."""

    def __init__(self, bus: Bus) -> None:
        self._bus, self._seq = bus, 0
        self._is_on = {"lidar": False, "navcam": False}
        self._pair = walls.pair(np.eye(4))
        self._ground = hills(1)
        self._T_site_lidar = pose_on_ground(self._ground, 0.0, 0.0, 0.0)
        self._rng = np.random.default_rng(0)
        self._stop = threading.Event()
        bus.subscribe(keys.event("mana", "sensor_mode"), self._on_mode)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _on_mode(self, message: Message) -> None:
        body = unpack(message.payload)
        self._is_on[body["sensor"]] = bool(body["on"]) and not body.get("lost")

    def _run(self) -> None:
        while not self._stop.wait(PERIOD_S):
            stamp_ns = wall_ns()
            if self._is_on["lidar"]:
                T = self._T_site_lidar
                self._send(
                    "lidar", "scan", "mana/lidar", scan(self._ground, T, T, stamp_ns, self._rng), stamp_ns
                )
            if self._is_on["navcam"]:
                pair = FramePair.from_images(
                    np.array(self._pair.left.image),
                    np.array(self._pair.right.image),
                    baseline_m=self._pair.baseline,
                    camera_matrix=walls.K,
                    stamp_ns=stamp_ns,
                    sensor="mana/navcam_left",
                )
                self._send("navcam", "pair", "mana/navcam_left", pair, stamp_ns)

    def _send(self, sensor: str, stream: str, frame: str, value: Any, stamp_ns: int) -> None:
        self._seq += 1
        header = Header(
            id=product_id("mana", sensor, stream, stamp_ns, self._seq, ""),
            seq=self._seq,
            t0_ns=stamp_ns,
            t1_ns=stamp_ns,
            frame=frame,
            producer=sensor,
        )
        payload, encoding = encode_payload(value)
        self._bus.publish(
            keys.sensor("mana", sensor, stream), payload, encoding=encoding, attachment=header.to_attachment()
        )

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()


@pytest.fixture
def system(tmp_path: Path) -> Iterator[tuple[Bus, Client]]:
    """Bus and client of a system with samples of the rover's sensors."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with process_starter(endpoint, tmp_path) as spawn:
        spawn("services.router")
        spawn("services.dpm", "--profile", PROFILE, "--http", f"127.0.0.1:{free_port()}")
        spawn("services.orchestrator", "--profile", PROFILE)
        spawn("services.icu", "--profile", PROFILE)
        for name in ("mana_slam", "mana_vision", "mana_position"):
            spawn("services.dfpc_host", "--profile", PROFILE, "--process", name)
        with Bus.open(endpoint, name="rover", wait_s=120) as bus, Client(endpoint) as client:
            services = ("dpm", "orchestrator", "icu", "lidar_slam", "visual_slam", "position_manager")
            wanted = {keys.alive("mana", s) for s in services}
            eventually(lambda: wanted <= bus.alive(keys.alive("mana", "*")), 300, "start-up")
            rover = Rover(bus)
            yield bus, client
            rover.stop()


def fix_source(plan: dict[str, Any]) -> str:
    """Return the source of the fixes of the position manager in a plan."""
    assert plan["provider"] == "mana/position_manager", plan
    return str(plan["sources"]["mana/position_manager"]["fix"])


def fixes(bus: Bus) -> int:
    """Return the number of fixes that the position manager has received; 0 while it is inactive."""
    status = bus.call(keys.dfpc_rpc("mana", "position_manager", "status")).body()
    return int(status.get("samples_by_port", {}).get("fix", 0))


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-027")
def test_visual_compounds_correct_the_pose_when_the_lidar_has_failed_and_the_explanation_states_why(
    system: tuple[Bus, Client],
) -> None:
    bus, client = system
    explained = client.explain("pose", **POSE)
    assert fix_source(explained["plan"]) == "product/lidar_slam/pose"
    costs = {plan["provider"]: plan["cost"] for plan in explained["alternatives"]}
    assert costs["mana/lidar_slam"] < costs["mana/visual_slam"], "the lidar is chosen by its cost"
    assert client.request("pose", **POSE).delivered["source"].startswith("position_manager")

    bus.call(keys.icu_rpc("mana", "fault"), {"sensor": "lidar", "lost": "no power"})
    # The stored pose is no answer any more when it is older than asked.
    eventually(lambda: client.explain("pose", **POSE)["would"] == "make", 20, "a new plan")
    explained = client.explain("pose", **POSE)
    assert fix_source(explained["plan"]) == "product/visual_slam/pose"
    refused = {item["provider"]: item["why_not"] for item in explained["refused"]}
    assert "sensor mana/lidar is lost: no power" in refused["mana/lidar_slam"]
    answer = client.request("pose", **POSE)
    assert answer.delivered["source"].startswith("position_manager")
    assert fixes(bus) > 0
    np.testing.assert_allclose(answer.value.transform.matrix, np.eye(4), atol=0.02)
