# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to YARP with a name server and ports of this project, without common code."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import on_map
from cdff_common.clock import wall_ns
from cdff_common.codecs.bitstream import unwrap, wrap
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import Asn1Bitstream, TransformWithCovariance
from services.gateway_yarp.gateway import Gateway
from services.gateway_yarp.settings import YarpSettings
from services.yarp.bottle import decode_bottle, encode_bottle
from services.yarp.images import encode_yarp_image
from services.yarp.names import NameServer
from tests.integration.conftest import ROOT, Spawn, wait_until
from tests.support.gateway_traffic import collect_samples, gateway_in_thread, publish_product
from tests.support.secured_mission import secured_mission
from tests.support.yarp_peer import YarpInputPort, YarpNames, YarpOutputPort

pytestmark = pytest.mark.integration

_PAGE = (ROOT / "docs" / "how-to" / "yarp.md").read_text(encoding="utf-8")
_SETTINGS = _PAGE.partition("```yaml\n")[2].partition("```")[0]
_COMMAND = next(line for line in _PAGE.splitlines() if line.startswith("cdff service gateway_yarp"))
_IMU = {"port": "/robot/imu:o", "content": "imu", "stream": "imu/sample", "frame": "mana/imu"}
_IMAGE = {
    "port": "/robot/cam:o",
    "content": "image",
    "stream": "cam/frame",
    "frame": "mana/cam",
    "camera": [300.0, 310.0, 3.0, 2.0],
}
_BITS = {"port": "/robot/bits:o", "content": "bitstream", "stream": "bits/any", "frame": "mana/base"}
_BITS["without_stamp"] = "arrival"
_HELD = {
    "port": "/robot/bits:o",
    "content": "bitstream",
    "stream": "wheels/pose",
    "frame": "mana/odom",
    "child": "mana/base",
    "holds": "TransformWithCovariance",
    "without_stamp": "arrival",
}


def test_a_gateway_with_the_identity_of_its_robot_passes_the_access_control(tmp_path: Path) -> None:
    with secured_mission(tmp_path) as mission, closing(YarpNames()) as names:
        samples: list[Message] = []
        states: list[dict[str, Any]] = []
        ground = mission.bus("ground")
        ground.subscribe(keys.sensor("mana", "imu", "sample"), samples.append)
        ground.subscribe(
            keys.gateway_status("mana", "gateway_yarp"), on_map(lambda _, body: states.append(body))
        )
        model = YarpSettings.model_validate({"robot": "mana", "inputs": [_IMU]})
        server = NameServer("127.0.0.1", names.port, "/cdff")
        gateway = Gateway(model, mission.bus("mana"), server, "127.0.0.1")
        with closing(YarpOutputPort(names, "/robot/imu:o")) as port, gateway_in_thread(gateway):
            wait_until(lambda: port.targets, 15.0, "the port is connected")

            def is_received() -> bool:
                stamp_us = wall_ns() // 1000
                stamp = f"{stamp_us // 1_000_000}.{stamp_us % 1_000_000:06d}"
                port.send(encode_bottle(np.ones(12)), stamp)
                return bool(samples and states)

            wait_until(is_received, 15.0, "a sample and the status")


@pytest.fixture
def bus(router: object, endpoint: str) -> Iterator[Bus]:
    with Bus.open(endpoint, name="test", wait_s=20.0) as bus:
        yield bus


@contextmanager
def running(settings: dict[str, Any], endpoint: str, names: YarpNames) -> Iterator[Gateway]:
    """Yield a gateway that runs in a thread."""
    with Bus.open(endpoint, name="gateway", wait_s=20.0) as bus:
        model = YarpSettings.model_validate({"robot": "mana", **settings})
        gateway = Gateway(model, bus, NameServer("127.0.0.1", names.port, "/cdff"), "127.0.0.1")
        with gateway_in_thread(gateway):
            yield gateway


def _pose(stamp_ns: int) -> TransformWithCovariance:
    T = se3.transform(se3.exp_so3([0.0, 0.0, 0.5]), [1.0, 2.0, 3.0])
    return TransformWithCovariance.from_transform(
        UncertainTransform(T), parent="mana/odom", child="mana/base", stamp_ns=stamp_ns
    )


def test_messages_of_the_robot_become_samples(bus: Bus, endpoint: str, rng: np.random.Generator) -> None:
    imus = collect_samples(bus, "imu/sample", "IMUSensors")
    frames = collect_samples(bus, "cam/frame", "Frame")
    bits = collect_samples(bus, "bits/any", "Asn1Bitstream")
    poses = collect_samples(bus, "wheels/pose", "TransformWithCovariance")
    image = rng.integers(0, 255, (4, 6, 3)).astype(np.uint8)
    with closing(YarpNames()) as names:
        ports = {entry["port"]: YarpOutputPort(names, str(entry["port"])) for entry in (_IMU, _IMAGE, _BITS)}
        with running({"inputs": [_IMU, _IMAGE, _BITS, _HELD]}, endpoint, names) as gateway:
            wait_until(
                lambda: sum(len(port.targets) for port in ports.values()) == 4,
                15.0,
                "all ports are connected",
            )
            stamp_us = wall_ns() // 1000
            stamp = f"{stamp_us // 1_000_000}.{stamp_us % 1_000_000:06d}"
            imu = np.array([0.0, 0.0, 90.0, 0.1, 0.2, 9.8, 0.0, 0.0, 180.0, 1.0, 2.0, 3.0])
            ports["/robot/imu:o"].send(encode_bottle(imu), stamp)
            ports["/robot/cam:o"].send(encode_yarp_image(image, "BGR"), stamp)
            pose = _pose(1000 * stamp_us)
            wrapped = wrap(pose)
            ports["/robot/bits:o"].send(encode_bottle([wrapped.type, bytes(wrapped.data)]))
            wait_until(lambda: imus and frames and bits and poses, 10.0, "samples of all ports")
            ports["/robot/imu:o"].send(encode_bottle(imu))
            ports["/robot/imu:o"].send(encode_bottle(imu[:5]), stamp)
            ports["/robot/imu:o"].send(b"nonsense", stamp)

            def dropped() -> dict[str, int]:
                return dict(gateway.status()["inputs"]["/robot/imu:o"]["dropped"])

            wait_until(lambda: dropped() == {"content": 2, "decoding": 1}, 10.0, "faults are counted")
        for port in ports.values():
            port.close()
        assert not [name for name in names.records if name.startswith("/cdff")]
    np.testing.assert_allclose(imus[0].gyro, [0.0, 0.0, np.pi])
    np.testing.assert_array_equal(imus[0].acc, [0.1, 0.2, 9.8])
    assert imus[0].stamp_ns == 1000 * stamp_us
    np.testing.assert_array_equal(frames[0].image, image)
    assert frames[0].camera_matrix[1, 1] == 310.0
    assert unwrap(bits[0]) == poses[0] == pose


def test_products_become_messages_and_a_port_that_comes_back_is_connected_again(
    bus: Bus, endpoint: str
) -> None:
    outputs = [
        {"product": "position_manager/pose", "port": "/robot/pose:i", "content": "pose"},
        {"product": "position_manager/pose", "port": "/robot/bits:i"},
    ]
    stamp_ns = wall_ns() // 1000 * 1000
    pose = _pose(stamp_ns)

    with closing(YarpNames()) as names, running({"outputs": outputs}, endpoint, names):
        for _ in range(2):
            with (
                closing(YarpInputPort(names, "/robot/pose:i")) as poses,
                closing(YarpInputPort(names, "/robot/bits:i")) as bits,
            ):

                def is_received(poses: Any = poses, bits: Any = bits) -> bool:
                    publish_product(
                        bus, "position_manager/pose", pose, stamp_ns, frame="mana/odom", child="mana/base"
                    )
                    return bool(poses.received and bits.received)

                wait_until(is_received, 15.0, "both messages")
                (envelope, data), (_, wrapped) = poses.received[0], bits.received[0]
            seconds, microseconds = divmod(stamp_ns // 1000, 1_000_000)
            assert envelope.split()[2] == f"{seconds}.{microseconds:06d}"
            numbers = decode_bottle(data)
            np.testing.assert_array_equal(numbers[:3], pose.data.translation)
            np.testing.assert_array_equal(numbers[3:], pose.data.orientation)
            name, content = decode_bottle(wrapped)
            assert unwrap(Asn1Bitstream(name, 0, np.frombuffer(content, np.uint8))) == pose


@pytest.mark.slow
def test_the_settings_and_the_command_of_the_page_connect_its_ports(
    bus: Bus, endpoint: str, spawn: Spawn, tmp_path: Path
) -> None:
    contents = {
        "imu/sample": ("IMUSensors", "/robot/inertial:o", encode_bottle(np.ones(12))),
        "cam/frame": (
            "Frame",
            "/robot/cam/left:o",
            encode_yarp_image(np.zeros((480, 640, 3), np.uint8), "RGB"),
        ),
        "wheels/odometry": (
            "TransformWithCovariance",
            "/robot/odometry:o",
            encode_bottle(np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0])),
        ),
        "lidar/scan": ("LidarScan", "/robot/lidar:o", encode_bottle(np.arange(6.0))),
    }
    samples = {stream: collect_samples(bus, stream, kind) for stream, (kind, _, _) in contents.items()}
    settings = tmp_path / "gateway.yaml"
    settings.write_text(_SETTINGS)
    with ExitStack() as stack:
        names = stack.enter_context(closing(YarpNames()))
        ports = {
            port: stack.enter_context(closing(YarpOutputPort(names, port)))
            for _, port, _ in contents.values()
        }
        poses = stack.enter_context(closing(YarpInputPort(names, "/robot/pose:i")))
        maps = stack.enter_context(closing(YarpInputPort(names, "/robot/maps:i")))
        command = _COMMAND.replace("gateway.yaml", str(settings)).replace("192.168.1.30", "127.0.0.1")
        command = command.replace("192.168.1.20", f"127.0.0.1:{names.port}")
        spawn("cdff_common.cli", *shlex.split(command)[1:])
        wait_until(lambda: all(port.targets for port in ports.values()), 30.0, "all ports are connected")

        def is_exchanged() -> bool:
            stamp_ns = wall_ns() // 1000 * 1000
            for _, port, data in contents.values():
                ports[port].send(data, f"{stamp_ns // 10**9}.{stamp_ns % 10**9 // 1000:06d}")
            publish_product(
                bus,
                "position_manager/pose",
                _pose(stamp_ns),
                stamp_ns,
                frame="mana/odom",
                child="mana/base",
            )
            publish_product(
                bus, "digital_elevation_mapping/map", _pose(stamp_ns), stamp_ns, frame="mana/odom"
            )
            return bool(all(samples.values()) and poses.received and maps.received)

        wait_until(is_exchanged, 15.0, "a sample of each input and a message of each output")
    frame, scan, pose = samples["cam/frame"][0], samples["lidar/scan"][0], samples["wheels/odometry"][0]
    assert (frame.camera_matrix[0, 0], frame.camera_matrix[1, 2]) == (320.5, 239.5)
    np.testing.assert_array_equal(scan.points_m, np.arange(6.0).reshape(2, 3))
    assert (pose.parent_frame, pose.child_frame) == ("mana/odom", "mana/base")
