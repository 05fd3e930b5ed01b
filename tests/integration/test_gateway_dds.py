# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to ROS 2 on DDS as a process, with a real rclpy on Fast DDS as the robot."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cdff_common.bus import Bus, Message, keys
from cdff_common.clock import wall_ns
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import TransformWithCovariance
from services.dfpc_host.inputs import decode_sample
from services.gateway_dds.settings import DdsSettings
from tests.integration.conftest import Spawn, process_starter, wait_until
from tests.support.gateway_traffic import publish_navigation_map, publish_product

pytestmark = [pytest.mark.integration, pytest.mark.slow]

_ROOT = Path(__file__).resolve().parents[2]
_PYTHON = _ROOT / "build" / "dds-peers" / "bin" / "python"
_CYCLONE = _ROOT / "build" / "cyclonedds"
#: Settings and command of the page.
_PAGE = (_ROOT / "docs" / "how-to" / "ros2-dds.md").read_text(encoding="utf-8")
_SETTINGS = _PAGE.partition("```yaml\n")[2].partition("```")[0]
_COMMAND = next(line for line in _PAGE.splitlines() if line.startswith("cdff service gateway_dds"))
_MAST = {"topic": "/tf", "type": "tf2_msgs/msg/TFMessage", "stream": "mast/pose"}
#: Points of the cloud: 1.2 MB, many fragments of DDS.
_POINTS = 100_000


def publish_pose(bus: Bus, seq: int) -> None:
    stamp_ns = wall_ns() // 1000 * 1000
    transform = UncertainTransform(se3.transform(np.eye(3), np.array([1.0, 2.0, 3.0])), 0.25 * np.eye(6))
    value = TransformWithCovariance.from_transform(
        transform, parent="mana/odom", child="mana/base", stamp_ns=stamp_ns, producer="position_manager"
    )
    publish_product(
        bus, "position_manager/pose", value, stamp_ns, frame="mana/odom", child="mana/base", seq=seq
    )


def test_rclpy_sends_sensors_receives_products_and_conflicts_are_named(endpoint: str, tmp_path: Path) -> None:
    if not _PYTHON.exists() or not _CYCLONE.is_dir():
        pytest.skip("rclpy or Cyclone DDS is not installed; make peers installs them")
    domain = 1 + os.getpid() % 90
    path = tmp_path / "gateway.yaml"
    path.write_text(_SETTINGS.replace("domain: 0", f"domain: {domain}"))
    packages = os.pathsep.join([str(_ROOT), str(_CYCLONE)])
    with process_starter(endpoint, tmp_path, PYTHONPATH=packages) as start:
        start("services.router")
        with Bus.open(endpoint, name="test") as bus:
            _run(bus, start, path, domain)


def _run(bus: Bus, start: Spawn, path: Path, domain: int) -> None:
    noun, *options = shlex.split(_COMMAND.replace("gateway.yaml", str(path)))[1:]
    start("cdff_common.cli", noun, *options)
    wait_until(lambda: bus.alive(keys.alive("mana", "gateway_dds")), 60.0, "the gateway is ready")
    samples: dict[str, list[Message]] = {}
    for stream in ("imu/sample", "lidar/scan", "wheels/odometry"):
        bus.subscribe(keys.sensor("mana", *stream.split("/")), samples.setdefault(stream, []).append)
    publish_navigation_map(bus)  # before the robot exists, whose subscription is transient local
    environment = {
        "PATH": os.environ["PATH"],
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(path.parent),
    }
    command = [str(_PYTHON), str(Path(__file__).with_name("dds_peer.py")), "100", str(_POINTS)]

    def inputs() -> dict[str, Any]:
        state: dict[str, Any] = bus.call(keys.gateway_status("mana", "gateway_dds")).body()
        return {topic: state["inputs"][topic]["dropped"] for topic in ("/imu/data", "/odom")}

    with subprocess.Popen(
        command, stdout=subprocess.PIPE, env=environment, text=True, cwd=path.parent
    ) as peer:
        try:
            for seq in range(700):
                publish_pose(bus, seq)
                with suppress(subprocess.TimeoutExpired):
                    peer.wait(0.2)
                    break
            else:
                pytest.fail("the peer did not end within 140 s")
            # Messages wait in the gateway, whose status is published once in a period.
            dropped = {"/imu/data": {"decoding": 1}, "/odom": {"content": 1}}
            wait_until(lambda: all(samples.values()) and inputs() == dropped, 30.0, "all messages are used")
            assert peer.stdout is not None
            received = json.loads(peer.stdout.read())
        finally:
            peer.kill()
    assert received["poses"] >= 3
    assert (received["frame"], received["z"]) == ("odom", 3.0)
    width, height, cells = received["map"]
    assert (width, height, len(cells)) == (3, 2, 6)
    imu = decode_sample(samples["imu/sample"][0], "imu", "IMUSensors")
    np.testing.assert_array_equal(imu.value.acc, [0.25, 0.5, 9.75])
    assert imu.frame == "mana/imu"
    scan = decode_sample(samples["lidar/scan"][0], "scan", "LidarScan")
    assert scan.value.points_m.shape == (_POINTS, 3)
    np.testing.assert_array_equal(scan.value.points_m[-1], [1.0, 2.0, 3.0])
    odometry = decode_sample(samples["wheels/odometry"][0], "odometry", "TransformWithCovariance")
    np.testing.assert_array_equal(odometry.value.data.translation, [1.5, 0.0, 0.0])
    state: dict[str, Any] = bus.call(keys.gateway_status("mana", "gateway_dds")).body()
    assert state["conflicts"]["/odom"] == "a publisher has another reliability"
    assert "std_msgs::msg::dds_::String_" in state["conflicts"]["/lidar/points"]


def test_cyclone_dds_sends_and_receives_the_frame_tree(endpoint: str, tmp_path: Path) -> None:
    if not _CYCLONE.is_dir():
        pytest.skip("Cyclone DDS is not installed; make peers installs it")
    domain = 91 + os.getpid() % 90
    settings = yaml.safe_load(_SETTINGS) | {"domain": domain, "requests": []}
    settings["inputs"] = [{**_MAST, "frame": "mana/base", "child": "mana/mast"}]
    path = tmp_path / "gateway.yaml"
    path.write_text(yaml.safe_dump(settings))
    packages = os.pathsep.join([str(_ROOT), str(_CYCLONE)])
    environment = {
        "PATH": os.environ["PATH"],
        "PYTHONPATH": packages,
        "ROS_DOMAIN_ID": str(domain),
        "CYCLONEDDS_URI": DdsSettings.model_validate(settings).configuration,
    }
    command = [sys.executable, str(Path(__file__).with_name("dds_tree_peer.py")), "60"]
    with process_starter(endpoint, tmp_path, PYTHONPATH=packages) as start:
        start("services.router")
        with Bus.open(endpoint, name="test") as bus:
            start("services.gateway_dds", "--settings", str(path))
            wait_until(lambda: bus.alive(keys.alive("mana", "gateway_dds")), 60.0, "the gateway is ready")
            samples: list[Message] = []
            bus.subscribe(keys.sensor("mana", "mast", "pose"), samples.append)
            with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True) as peer:
                try:
                    for seq in range(400):
                        publish_pose(bus, seq)
                        with suppress(subprocess.TimeoutExpired):
                            peer.wait(0.2)
                            break
                    assert peer.stdout is not None
                    received = json.loads(peer.stdout.read())
                finally:
                    peer.kill()
            wait_until(lambda: samples, 10.0, "a pose of the mast")
    assert received["frames"] == ["odom", "base_link"]
    assert received["position"] == [1.0, 2.0, 3.0]
    mast = decode_sample(samples[0], "pose", "TransformWithCovariance")
    assert (mast.frame, mast.child) == ("mana/base", "mana/mast")
    np.testing.assert_array_equal(mast.value.data.translation, [0.5, 0.0, 1.25])
