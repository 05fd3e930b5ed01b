# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to ROCK with omniNames and a task of this project by omniORB, which sends recorded values."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus
from cdff_common.client import Client
from cdff_common.clock import wall_ns
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import TransformWithCovariance
from cdff_dev.logs import open_log
from cdff_dev.logs.formats.pocolog.blocks import read_blocks
from cdff_dev.logs.formats.pocolog.decoding import decode_sample
from cdff_dev.logs.formats.pocolog.registry import Registry
from services.gateway_rock.gateway import Gateway
from services.gateway_rock.settings import RockSettings
from services.rock_types.values import plain
from tests.integration.conftest import ROOT, Spawn, wait_until
from tests.support.gateway_traffic import collect_samples, gateway_in_thread, publish_product
from tests.support.rock_name_service import PEERS, name_service

IDL = Path(__file__).parent / "rock"
RECORDED = Path(os.environ.get("CDFF_DATA", "../shared/data")) / "pocolog"
pytestmark = [
    pytest.mark.integration,
    pytest.mark.skipif(not (PEERS / "omniNames").is_file(), reason="no omniORB; make peers installs it"),
]

_STATE, _SCAN = "/base/samples/RigidBodyState", "/base/samples/LaserScan"
_POSE = {
    "task": "sensor_task",
    "port": "pose",
    "type": _STATE,
    "stream": "wheels/pose",
    "frame": "mana/odom",
    "child": "mana/base",
}
_PAGE = (ROOT / "docs" / "how-to" / "rock.md").read_text(encoding="utf-8")
_SETTINGS = _PAGE.partition("```yaml\n")[2].partition("```")[0]
_COMMAND = next(line for line in _PAGE.splitlines() if line.startswith("cdff service gateway_rock"))
_FRAMES = {"body": "mana/base", "map": "mana/odom"}


def _state(stamp_us: int, x_m: float = 1.0) -> dict[str, Any]:
    """A pose as plain data; its covariances differ in their columns."""
    matrix = {"data": [1.0, 0.1, 0.0, 0.2, 2.0, 0.0, 0.0, 0.0, 3.0]}
    return {
        "time": {"microseconds": stamp_us},
        "sourceFrame": "body",
        "targetFrame": "map",
        "position": {"data": [x_m, 2.0, 3.0]},
        "cov_position": matrix,
        "orientation": {"im": [0.0, 0.0, 1.0], "re": 0.0},
        "cov_orientation": {"data": list(np.eye(3).ravel())},
        "velocity": {"data": [0.0] * 3},
        "cov_velocity": matrix,
        "angular_velocity": {"data": [0.0] * 3},
        "cov_angular_velocity": matrix,
    }


@contextmanager
def running_task(folder: Path, names_port: int, ports: dict[str, Any]) -> Iterator[Path]:
    """Yield the file of the samples that a task receives, while it runs with samples for its output ports."""
    values, received = folder / "values.json", folder / "received.json"
    values.write_text(json.dumps(ports))
    received.touch()
    command = [PEERS / "python", IDL.parent / "rock_servant.py", IDL, str(names_port), values, received]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == b"ready\n"
        yield received
    finally:
        process.kill()
        process.communicate()


@contextmanager
def running_gateway(settings: dict[str, Any], endpoint: str, names_port: int) -> Iterator[Gateway]:
    """Yield a gateway that runs in a thread."""
    with Bus.open(endpoint, name="gateway", wait_s=20.0) as bus, Client(endpoint) as client:
        model = RockSettings.model_validate({"robot": "mana", "frames": _FRAMES, **settings})
        gateway = Gateway(model, bus, client, "127.0.0.1", names_port)
        with gateway_in_thread(gateway):
            yield gateway


@pytest.fixture
def bus(router: object, endpoint: str) -> Iterator[Bus]:
    with Bus.open(endpoint, name="test", wait_s=20.0) as bus:
        yield bus


def _recorded(name: str, stamp_us: int) -> dict[str, Any]:
    """The first recorded value of a file as plain data with a stamp, as the file has none."""
    path = RECORDED / name
    messages = next(s for s in read_blocks(path).streams if s.name.endswith(".messages"))
    kind = Registry(messages.registry, "<").build(messages.type_name)
    data = path.read_bytes()[messages.starts[0] : messages.starts[0] + messages.sizes[0]]
    value = plain(decode_sample(kind, data, "<"))
    lists = {name: item.tolist() if isinstance(item, np.ndarray) else item for name, item in value.items()}
    return {**lists, "time": {"microseconds": stamp_us}}


def test_a_pose_and_its_covariance_arrive_in_the_frames_of_the_settings(
    bus: Bus, endpoint: str, tmp_path: Path
) -> None:
    samples = collect_samples(bus, "wheels/pose", "TransformWithCovariance")
    stamp_us = wall_ns() // 1000
    ports = {"pose": {"type": _STATE, "idl": "RigidBodyState", "values": [_state(stamp_us)]}}
    with (
        name_service(tmp_path / "names") as names_port,
        running_task(tmp_path, names_port, ports),
        running_gateway({"inputs": [_POSE]}, endpoint, names_port) as gateway,
    ):
        wait_until(lambda: samples, 20.0, "a sample")
        (value,) = samples
        assert (value.parent_frame, value.child_frame, value.stamp_ns) == (
            "mana/odom",
            "mana/base",
            1000 * stamp_us,
        )
        np.testing.assert_array_equal(value.data.translation, [1.0, 2.0, 3.0])
        np.testing.assert_array_equal(value.data.orientation, [0.0, 0.0, 1.0, 0.0])
        expected = [[1.0, 0.2, 0.0], [0.1, 2.0, 0.0], [0.0, 0.0, 3.0]]  # Eigen stores columns
        np.testing.assert_array_equal(value.data.cov[:3, :3], expected)
        counters = gateway.status()["inputs"]["sensor_task.pose"]
        assert counters["connected"]
        assert (counters["received"], counters["forwarded"], counters["dropped"]) == (1, 1, {})


def test_a_product_is_written_to_a_port_with_the_type_that_the_robot_states(
    bus: Bus, endpoint: str, tmp_path: Path
) -> None:
    ports = {"pose": {"type": _STATE, "idl": "RigidBodyState", "values": [_state(1)], "repeat": True}}
    output = {
        "product": "position_manager/pose",
        "task": "sensor_task",
        "port": "pose_samples",
        "type": _STATE,
        "type_of": "sensor_task.pose",
    }
    stamp_ns = wall_ns() // 1000 * 1000
    covariance = np.diag([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    T = se3.transform(se3.exp_so3([0.0, 0.0, np.pi / 2]), [1.0, 2.0, 3.0])
    pose = TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance), parent="mana/odom", child="mana/base", stamp_ns=stamp_ns
    )
    with (
        name_service(tmp_path / "names") as names_port,
        running_task(tmp_path, names_port, ports) as received,
        running_gateway({"outputs": [output]}, endpoint, names_port) as gateway,
    ):
        wait_until(lambda: gateway.status()["outputs"][0]["connected"], 20.0, "the connection")

        def is_received() -> bool:
            publish_product(
                bus, "position_manager/pose", pose, stamp_ns, frame="mana/odom", child="mana/base"
            )
            return bool(received.read_text())

        wait_until(is_received, 10.0, "the pose at the task")
        value = json.loads(received.read_text().splitlines()[0])
    assert (value["sourceFrame"], value["targetFrame"]) == ("body", "map")
    assert value["time"]["microseconds"] == stamp_ns // 1000
    np.testing.assert_allclose(value["position"]["data"], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(value["cov_position"]["data"], np.diag([1.0, 2.0, 3.0]).ravel())
    # A rotation by 90 degrees about z: the axes x and y of the body are y and -x of the parent.
    np.testing.assert_allclose(value["cov_orientation"]["data"], np.diag([0.2, 0.1, 0.3]).ravel(), atol=1e-12)
    assert np.isnan(value["velocity"]["data"]).all()


def test_a_restart_of_the_task_is_survived(bus: Bus, endpoint: str, tmp_path: Path) -> None:
    samples = collect_samples(bus, "wheels/pose", "TransformWithCovariance")
    stamp_us = wall_ns() // 1000
    with (
        name_service(tmp_path / "names") as names_port,
        running_gateway({"inputs": [{**_POSE, "on_clock_fault": "report"}]}, endpoint, names_port) as gateway,
    ):
        for i in range(2):
            value = _state(stamp_us + i, float(i))
            ports = {"pose": {"type": _STATE, "idl": "RigidBodyState", "values": [value]}}
            with running_task(tmp_path, names_port, ports):
                wait_until(lambda i=i: len(samples) == i + 1, 20.0, "a sample")
            wait_until(
                lambda: not gateway.status()["inputs"]["sensor_task.pose"]["connected"],
                10.0,
                "the end of the task",
            )
    assert [float(s.data.translation[0]) for s in samples] == [0.0, 1.0]


def test_a_port_of_another_type_and_a_missing_port_are_named(bus: Bus, endpoint: str, tmp_path: Path) -> None:
    scan = {**_POSE, "type": _SCAN, "stream": "lidar/scan", "frame": "mana/lidar", "child": None}
    missing = {**scan, "port": "scans", "stream": "lidar/other"}
    ports = {"pose": {"type": _STATE, "idl": "RigidBodyState", "values": []}}

    with (
        name_service(tmp_path / "names") as names_port,
        running_task(tmp_path, names_port, ports),
        running_gateway({"inputs": [scan, missing]}, endpoint, names_port) as gateway,
    ):

        def errors() -> list[str]:
            return [entry["last_error"] for entry in gateway.status()["inputs"].values()]

        wait_until(lambda: all(errors()), 20.0, "both are refused")
        assert errors() == [
            f"sensor_task.pose: type {_STATE}, expected {_SCAN}",
            "sensor_task: no port 'scans'; expected one of pose, pose_samples",
        ]


@pytest.mark.skipif(not RECORDED.is_dir(), reason=f"no shared data at {RECORDED}")
def test_recorded_values_become_the_same_samples_as_in_their_log(
    bus: Bus, endpoint: str, tmp_path: Path
) -> None:
    samples = collect_samples(bus, "lidar/scan", "LidarScan")
    with closing(open_log(RECORDED / "laser_scan.0.log")) as log:
        expected = next(log.samples()).value
    stamp_us = wall_ns() // 1000
    ports = {
        "scans": {"type": _SCAN, "idl": "LaserScan", "values": [_recorded("laser_scan.0.log", stamp_us)]}
    }
    entry = {
        "task": "sensor_task",
        "port": "scans",
        "type": _SCAN,
        "stream": "lidar/scan",
        "frame": "mana/lidar",
        "on_clock_fault": "report",  # the recorded mirror turns in 31 s
    }
    with (
        name_service(tmp_path / "names") as names_port,
        running_task(tmp_path, names_port, ports),
        running_gateway({"inputs": [entry]}, endpoint, names_port),
    ):
        wait_until(lambda: samples, 20.0, "a sample")
    np.testing.assert_array_equal(samples[0].points_m, expected.points_m)
    np.testing.assert_array_equal(samples[0].time_offset_us, expected.time_offset_us)
    assert samples[0].t0_ns == 1000 * stamp_us


def test_the_settings_and_the_command_of_the_page_connect_its_ports(
    bus: Bus, endpoint: str, spawn: Spawn, tmp_path: Path
) -> None:
    scans = collect_samples(bus, "lidar/scan", "LidarScan")
    poses = collect_samples(bus, "wheels/pose", "TransformWithCovariance")
    depth_map = {
        "time": {"microseconds": 0},
        "timestamps": [],
        "vertical_projection": "POLAR",
        "horizontal_projection": "POLAR",
        "vertical_interval": [0.0],
        "horizontal_interval": [0.1, -0.1],
        "vertical_size": 1,
        "horizontal_size": 2,
        "distances": [2.0, 3.0],
        "remissions": [],
    }
    sent = {"repeat": True, "stamp_now": True, "period_s": 0.02}
    state = {"type": _STATE, "idl": "RigidBodyState", "values": [_state(0)]}
    ports = {
        "velodyne.laser_scans": {
            "type": "/base/samples/DepthMap",
            "idl": "DepthMap",
            "values": [depth_map],
            **sent,
        },
        "odometry.pose_samples": {**state, **sent},
        "control.other": {**state, "values": []},
    }
    settings = tmp_path / "gateway.yaml"
    settings.write_text(_SETTINGS)
    T = se3.transform(np.eye(3), [1.0, 2.0, 3.0])
    with (
        name_service(tmp_path / "names") as names_port,
        running_task(tmp_path, names_port, ports) as received,
    ):
        command = _COMMAND.replace("gateway.yaml", str(settings)).replace(
            "192.168.1.20", f"127.0.0.1:{names_port}"
        )
        spawn("cdff_common.cli", *shlex.split(command)[1:])
        wait_until(lambda: scans and poses, 30.0, "samples of both inputs")

        def is_received() -> bool:
            stamp_ns = wall_ns() // 1000 * 1000
            pose = TransformWithCovariance.from_transform(
                UncertainTransform(T), parent="mana/odom", child="mana/base", stamp_ns=stamp_ns
            )
            publish_product(
                bus, "position_manager/pose", pose, stamp_ns, frame="mana/odom", child="mana/base"
            )
            return bool(received.read_text())

        wait_until(is_received, 10.0, "the pose at the task control")
    angles = np.array([0.1, -0.1])
    expected = np.array([2.0, 3.0])[:, None] * np.stack(
        [np.cos(angles), np.sin(angles), 0.0 * angles], axis=1
    )
    np.testing.assert_allclose(scans[0].points_m, expected, atol=1e-6)
    assert (poses[0].parent_frame, poses[0].child_frame) == ("mana/odom", "mana/base")
    value = json.loads(received.read_text().splitlines()[0])
    assert (value["sourceFrame"], value["targetFrame"]) == ("body", "map")
