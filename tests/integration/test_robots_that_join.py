# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A second robot joins a running ground by its own ``cdff up``, returns with another profile, and leaves."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path
from typing import Any

import httpx
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.cli import main
from cdff_common.client import Client
from cdff_common.errors import CdffError, ProductNotFoundError, UnavailableError
from cdff_dev.ports import free_port
from tests.integration.conftest import Eventually, Spawn
from tests.support.identities import open_as

pytestmark = [pytest.mark.integration, pytest.mark.timeout(180)]

PROFILE = """
name: {mission}
body: {{name: {body}}}
robots:
  - id: {robot}
    frames:
      - {{parent: site, child: {robot}/odom}}
      - {{parent: {robot}/base, child: {robot}/imu, translation_m: [{x_m}, 0.0, 0.2]}}
    sensors:
      imu:
        kind: imu
        frame: {robot}/imu
        initial_mode: {mode}
        streams: {{sample: IMUSensors}}
        modes: {{"off": {{on: false}}, {mode}: {{rate_hz: 20.0}}}}
    dfpcs:
      - name: position_manager
        inputs: {{imu: sensor/imu/sample}}
        modes: {{imu: {mode}}}
"""


def text_of(robot: str, mission: str, body: str = "moon", x_m: float = 0.0, mode: str = "nominal") -> str:
    return PROFILE.format(robot=robot, mission=mission, body=body, x_m=x_m, mode=mode)


class Ground:
    """A ground with the robot ``pico``, and the machines of robots that join it."""

    def __init__(self, endpoint: str, spawn: Spawn, folder: Path, secrets: Path | None = None) -> None:
        self.endpoint, self._spawn, self._folder, self._secrets = endpoint, spawn, folder, secrets
        self.http = f"127.0.0.1:{free_port()}"
        profile = folder / "ground.yaml"
        profile.write_text(text_of("pico", "ground"))
        self.process = self.up(profile, "ground", "--http", self.http, connect=endpoint)

    def up(
        self, profile: Path, name: str, *options: str, connect: str | None = None
    ) -> subprocess.Popen[bytes]:
        address = connect or f"{self.endpoint.partition('/')[0]}/127.0.0.1:{free_port()}"
        arguments = ["--profile", str(profile), "--connect", address, "--data-dir", str(self._folder / name)]
        arguments += [] if self._secrets is None else ["--secure", str(self._secrets)]
        return self._spawn("cdff_common.cli", "up", *arguments, *options)

    def join(self, robot: str, **changes: Any) -> subprocess.Popen[bytes]:
        """Start a robot's own machine."""
        profile = self._folder / f"{robot}.yaml"
        profile.write_text(text_of(robot, f"{robot}_mission", **changes))
        return self.up(profile, robot, "--scopes", robot, "--uplink", self.endpoint)

    def get(self, path: str) -> Any:
        return httpx.get(f"http://{self.http}{path}", timeout=5).raise_for_status().json()

    def catalogue(self, bus: Bus) -> list[dict[str, Any]]:
        answer = bus.call(keys.orchestrator_rpc("ground", "catalogue"), {"robot": "any"}, timeout_s=5)
        return list(answer.body()["dfpcs"])

    def modes(self, bus: Bus, robot: str) -> dict[str, Any]:
        answer = bus.call(keys.icu_rpc("ground", "modes"), {"robot": robot}, timeout_s=5)
        return dict(answer.body()["sensors"])


@pytest.mark.slow
def test_a_robot_joins_returns_with_another_profile_and_leaves_a_running_ground(
    endpoint: str, spawn: Spawn, tmp_path: Path, eventually: Eventually
) -> None:
    ground = Ground(endpoint, spawn, tmp_path)
    with Bus.open(endpoint, name="test", wait_s=60) as bus:

        def robots() -> set[str]:
            try:
                return {str(d["robot"]) for d in ground.catalogue(bus) if d["alive"]}
            except UnavailableError:
                return set()

        eventually(lambda: robots() == {"pico"}, timeout_s=60, what="the ground")
        machine = ground.join("nano")
        eventually(lambda: robots() == {"pico", "nano"}, timeout_s=60, what="nano in the catalogue")
        assert set(ground.modes(bus, "nano")) == {"imu"}
        eventually(lambda: stored_mounts(ground) == [0.0], what="nano's frames in the DPM")
        eventually(lambda: ("nano", "imu") in streams(ground), what="nano's streams in the status")
        first = robot_of(ground)["profile_revision"]
        assert first
        assert not robot_of(ground)["has_left"]
        with Client(endpoint) as client, pytest.raises(CdffError) as refused:
            client.request("pose", robot="nano", deadline_s=6)
        assert "nano/position_manager" in str(refused.value)  # it is active, and no driver sends samples
        assert ground.process.poll() is None

        machine.send_signal(signal.SIGTERM)
        machine.wait(20)
        eventually(lambda: robots() == {"pico"}, timeout_s=30, what="nano out of the catalogue")
        eventually(lambda: robot_of(ground)["has_left"], what="nano has left the page")
        assert ("nano", "imu") not in streams(ground)
        with pytest.raises(ProductNotFoundError, match="no robot 'nano' with sensors"):
            ground.modes(bus, "nano")
        with Client(endpoint) as client, pytest.raises(UnavailableError, match="left with robot nano"):
            client.request("pose", robot="nano", deadline_s=3)

        ground.join("nano", x_m=0.3, mode="fast")
        eventually(lambda: robots() == {"pico", "nano"}, timeout_s=60, what="nano's return")
        eventually(lambda: stored_mounts(ground) == [0.0, 0.3], what="a revision of nano's mount")
        assert set(ground.modes(bus, "nano")["imu"]["modes"]) == {"off", "fast"}
        assert robot_of(ground)["profile_revision"] not in ("", first)
        changes = [e["change"] for e in ground.get("/api/v1/history?kind=robot")["items"]]
        assert changes == ["joined", "left", "joined"]
    assert ground.process.poll() is None


@pytest.mark.slow
def test_a_secured_ground_admits_a_robot_that_got_its_identity_later_and_none_that_lost_it(
    spawn: Spawn, tmp_path: Path, eventually: Eventually
) -> None:
    profile, secrets = tmp_path / "ground.yaml", tmp_path / "secrets"
    profile.write_text(text_of("pico", "ground"))

    def issue(*arguments: str) -> None:
        assert main(["keys", *arguments, "--folder", str(secrets)]) == 0

    issue("init", "--profile", str(profile))
    issue("robot", "pico")
    issue("operator", "alice")
    ground = Ground(f"tls/127.0.0.1:{free_port()}", spawn, tmp_path, secrets)
    with open_as(secrets / "alice", ground.endpoint, wait_s=60) as bus:

        def robots() -> set[str]:
            try:
                return {str(d["robot"]) for d in ground.catalogue(bus) if d["alive"]}
            except UnavailableError:
                return set()

        eventually(lambda: robots() == {"pico"}, timeout_s=60, what="the ground")
        nano = tmp_path / "nano.yaml"
        nano.write_text(text_of("nano", "nano_mission"))
        issue("robot", "nano", "--profile", str(nano))
        ground.join("nano")
        eventually(lambda: robots() == {"pico", "nano"}, timeout_s=60, what="nano in the catalogue")
        frames = bus.call(keys.dpm_rpc("ground", "frames"), {"frame": "nano/imu"}, timeout_s=5).body()
        assert len(frames["revisions"]) == 1
        issue("revoke", "nano")
        eventually(lambda: robots() == {"pico"}, timeout_s=60, what="nano out of the catalogue")
    assert ground.process.poll() is None


def stored_mounts(ground: Ground) -> list[float]:
    """Return the x of each revision of nano's IMU."""
    try:
        items = ground.get("/api/v1/frames/nano/imu/revisions")["items"]
    except httpx.HTTPStatusError:
        return []
    return [revision["T"][0][3] for revision in items]


def streams(ground: Ground) -> set[tuple[str, str]]:
    return {(s["robot"], s["sensor"]) for s in ground.get("/api/v1/status")["overview"]["streams"]}


def robot_of(ground: Ground) -> dict[str, Any]:
    return dict(ground.get("/api/v1/robots/nano"))
