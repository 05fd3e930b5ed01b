# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to YARP with a name server and ports of this project, without common code."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import on_map
from cdff_common.clock import wall_ns
from cdff_common.codecs import encode_payload
from cdff_common.codecs.bitstream import unwrap, wrap
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import Asn1Bitstream, TransformWithCovariance
from services.dfpc_host.inputs import decode_sample
from services.gateway_yarp.gateway import Gateway
from services.gateway_yarp.settings import YarpSettings
from services.yarp.bottle import decode_bottle, encode_bottle
from services.yarp.images import encode_yarp_image
from services.yarp.names import NameServer
from tests.integration.conftest import wait_until
from tests.support.secured_mission import secured_mission
from tests.support.yarp_peer import YarpInputPort, YarpNames, YarpOutputPort

pytestmark = pytest.mark.integration

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
        gateway, stop = Gateway(model, mission.bus("mana"), server, "127.0.0.1"), threading.Event()
        thread = threading.Thread(target=gateway.run, args=(stop,))
        with closing(YarpOutputPort(names, "/robot/imu:o")) as port:
            thread.start()
            wait_until(lambda: port.targets, 15.0, "the port is connected")

            def is_received() -> bool:
                stamp_us = wall_ns() // 1000
                stamp = f"{stamp_us // 1_000_000}.{stamp_us % 1_000_000:06d}"
                port.send(encode_bottle(np.ones(12)), stamp)
                return bool(samples and states)

            wait_until(is_received, 15.0, "a sample and the status")
        stop.set()
        thread.join()


@pytest.fixture
def bus(router: object, endpoint: str) -> Iterator[Bus]:
    with Bus.open(endpoint, name="test", wait_s=20.0) as bus:
        yield bus


@contextmanager
def running(settings: dict[str, Any], endpoint: str, names: YarpNames) -> Iterator[Gateway]:
    """Yield a gateway that runs in a thread."""
    stop = threading.Event()
    with Bus.open(endpoint, name="gateway", wait_s=20.0) as bus:
        model = YarpSettings.model_validate({"robot": "mana", **settings})
        gateway = Gateway(model, bus, NameServer("127.0.0.1", names.port, "/cdff"), "127.0.0.1")
        thread = threading.Thread(target=gateway.run, args=(stop,))
        thread.start()
        try:
            yield gateway
            assert gateway.problem() == ""
        finally:
            stop.set()
            thread.join()


def _collect(bus: Bus, stream: str, type_name: str) -> list[Any]:
    samples: list[Any] = []

    def on_sample(message: Message) -> None:
        samples.append(decode_sample(message, stream, type_name).value)

    bus.subscribe(keys.sensor("mana", *stream.split("/")), on_sample)
    return samples


def _pose(stamp_ns: int) -> TransformWithCovariance:
    T = se3.transform(se3.exp_so3([0.0, 0.0, 0.5]), [1.0, 2.0, 3.0])
    return TransformWithCovariance.from_transform(
        UncertainTransform(T), parent="mana/odom", child="mana/base", stamp_ns=stamp_ns
    )


def test_messages_of_the_robot_become_samples(bus: Bus, endpoint: str, rng: np.random.Generator) -> None:
    imus = _collect(bus, "imu/sample", "IMUSensors")
    frames = _collect(bus, "cam/frame", "Frame")
    bits = _collect(bus, "bits/any", "Asn1Bitstream")
    poses = _collect(bus, "wheels/pose", "TransformWithCovariance")
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

    def publish() -> None:
        header = Header(
            id=product_id("mana", "position_manager", "pose", stamp_ns, 1, ""),
            seq=1,
            t0_ns=stamp_ns,
            t1_ns=stamp_ns,
            frame="mana/odom",
            child="mana/base",
            producer="position_manager",
        )
        payload, encoding = encode_payload(pose)
        key = keys.product("mana", "position_manager", "pose")
        bus.publish(key, payload, encoding=encoding, attachment=header.to_attachment())

    with closing(YarpNames()) as names, running({"outputs": outputs}, endpoint, names):
        for _ in range(2):
            with (
                closing(YarpInputPort(names, "/robot/pose:i")) as poses,
                closing(YarpInputPort(names, "/robot/bits:i")) as bits,
            ):

                def is_received(poses: Any = poses, bits: Any = bits) -> bool:
                    publish()
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
