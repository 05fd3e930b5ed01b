# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Connections to ports of the gateway that break its rules are counted, and so are products that are lost."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import UnavailableError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header
from cdff_common.types import TransformWithCovariance
from services.gateway_yarp import ports
from services.gateway_yarp.ports import YarpInput, YarpOutput
from services.gateway_yarp.settings import InputPort, OutputPort
from services.yarp.bottle import encode_bottle
from services.yarp.names import NameServer

_HELLO = b"YA\x64\x1e\0\0RP" + struct.pack("<I", 6) + b"/peer\0"
_STAMP_NS = 1_700_000_000_000_001_000


class _Samples:
    """The part of a sensor that an input uses."""

    def __init__(self, *_: object, **__: object) -> None:
        self.values: list[Any] = []

    def publish(self, value: Any, _: int = 0) -> bool:
        self.values.append(value)
        return True

    def close(self) -> None:
        """Nothing waits."""


class _Names(NameServer):
    """A name server with at most one port."""

    def __init__(self, port: int = 0) -> None:
        super().__init__("127.0.0.1", 1, "/cdff")
        self.known = port

    def query(self, name: str) -> tuple[str, int]:
        if not self.known:
            raise UnavailableError(f"{name}: not registered")
        return "127.0.0.1", self.known

    def register(self, name: str, host: str, port: int) -> None:
        """Accept the port."""

    def unregister(self, name: str) -> None:
        """Forget the port."""


def _wait(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[YarpInput]:
    monkeypatch.setattr("services.gateways.sample_link.Sensor", _Samples)
    entry = InputPort.model_validate(
        {
            "port": "/robot/imu:o",
            "content": "imu",
            "stream": "imu/sample",
            "frame": "mana/imu",
            "max_bytes": 200,
        }
    )
    bus: Any = None
    with closing(YarpInput(entry, "/cdff/imu:i", _Names(), "mana", "127.0.0.1", bus)) as port:
        port.start()
        yield port


def _message(data: bytes) -> bytes:
    text = f"D 1 {_STAMP_NS // 10**9}.{_STAMP_NS % 10**9 // 1000:06d}\0".encode()
    blocks = [struct.pack("<I", len(text)) + b"~\0\0\1", text, data]
    sizes = b"".join(struct.pack("<I", len(block)) for block in blocks)
    return b"YA\x0a\0\0\0RP" + bytes([3, 1]) + b"\xff" * 8 + sizes + bytes(4) + b"".join(blocks)


def _connect(port: YarpInput) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port._port), timeout=5.0)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"GET / HT", "handshake"),
        (b"CONNECT " + b"x" * 70_000, "handshake"),
        (_HELLO + b"nonsense", "decoding"),
        (_HELLO + _message(b"nonsense"), "decoding"),
        (_HELLO + _message(encode_bottle(np.ones(5))), "content"),
        (_HELLO + _message(bytes(300)), "size"),
    ],
)
def test_a_fault_of_a_connection_is_counted_with_its_reason(
    port: YarpInput, data: bytes, reason: str
) -> None:
    with _connect(port) as sock:
        sock.sendall(data)
        _wait(lambda: port.link.counters.to_map()["dropped"])
    assert port.link.counters.to_map()["dropped"] == {reason: 1}
    with _connect(port) as sock:
        sock.sendall(_HELLO + _message(encode_bottle(np.ones(12))))
        _wait(lambda: port.link.sensor.values)  # type: ignore[attr-defined]


def test_connections_beyond_the_limit_are_closed_and_counted(port: YarpInput) -> None:
    with ExitStack() as stack:
        for i in range(ports._MAX_CONNECTIONS):
            stack.enter_context(_connect(port)).sendall(_HELLO)
            _wait(lambda i=i: len(port._open) == i + 1)
        further = stack.enter_context(_connect(port))
        further.sendall(_HELLO)
        assert len(further.recv(8, socket.MSG_WAITALL)) == 8
        assert further.recv(1) == b""
    assert port.link.counters.to_map()["dropped"] == {"connections": 1}


def test_a_product_that_is_lost_with_its_connection_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ports, "_RETRY_S", 0.01)
    entry = OutputPort.model_validate({"product": "slam/pose", "port": "/robot/pose:i", "content": "pose"})
    pose = TransformWithCovariance.from_transform(
        UncertainTransform(np.eye(4)), parent="mana/odom", child="mana/base", stamp_ns=_STAMP_NS
    )
    stamps = {"t0_ns": _STAMP_NS, "t1_ns": _STAMP_NS}
    header = Header(id="x", seq=0, frame="mana/odom", producer="slam", **stamps)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        output = YarpOutput(entry, "/cdff/slam/pose:o", _Names(listener.getsockname()[1]))
        with closing(output):
            output.start()
            first, _ = listener.accept()
            with first:
                first.recv(4096)
                first.sendall(b"YA\0\0\0\0RP")
                _wait(lambda: output.is_connected)
                output.send(pose, header)
                first.recv(4096)
            _wait(lambda: output.counters.to_map()["dropped"] == {"connection": 1})
            second, _ = listener.accept()
            second.close()
