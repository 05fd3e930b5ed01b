# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Requests of a robot on DDS that arrive on a topic: answered, and refused if they are malformed."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError, UnavailableError

pytest.importorskip("cyclonedds", reason="Cyclone DDS is not installed; make peers installs it")

from services.gateway_dds.relayed_requests import BYTES, RelayedRequests, split_message
from services.gateways.frames import FrameNames
from services.gateways.settings import RequestEntry
from services.ros_messages.message_types import RosTypes

_ID = bytes(range(16))


class _Node:
    """Records the published messages."""

    def __init__(self) -> None:
        self.published: list[Any] = []
        self.arrived = threading.Event()

    def declare_publisher(self, topic: str, type_name: str, *, latched: bool) -> None: ...

    def subscribe(self, *arguments: Any) -> None: ...

    def publish(self, out: Any, *, latched: bool) -> None:
        self.published.append(out)
        self.arrived.set()


class _Client:
    def request(self, *_: Any, **__: Any) -> Any:
        raise UnavailableError("no map yet")


@pytest.fixture
def node() -> _Node:
    return _Node()


@pytest.fixture
def types() -> RosTypes:
    return RosTypes(2)


@pytest.fixture
def relayed(node: Any, types: RosTypes) -> RelayedRequests:
    entry = RequestEntry(name="/cdff/get_map", type="nav_msgs/srv/GetMap")
    client: Any = _Client()
    return RelayedRequests([entry], "cdff_gateway", FrameNames("mana"), types, node, client)


def _message(types: RosTypes, data: bytes) -> bytes:
    layout = types.make("std_msgs/MultiArrayLayout", dim=[], data_offset=0)
    message = types.make("std_msgs/UInt8MultiArray", layout=layout, data=np.frombuffer(data, np.uint8))
    return bytes(types.serialize(message, BYTES))


def _request(name: bytes) -> bytes:
    return _ID + len(name).to_bytes(2, "little") + name + b"\0\1\0\0\0"


def test_an_answer_has_the_identifier_of_its_request(
    relayed: RelayedRequests, node: _Node, types: RosTypes
) -> None:
    relayed.on_message(_message(types, _request(b"/cdff/get_map")))
    assert node.arrived.wait(10.0)
    relayed.close()
    (out,) = node.published
    assert out.topic == "/cdff_gateway/responses"
    identifier, name, content = split_message(bytes(out.message.data))
    assert (identifier, name) == (_ID, "/cdff/get_map")
    answer = types.deserialize(content, "nav_msgs/msg/GetMap_Response")
    assert len(answer.map.data) == 0
    assert relayed.requests[0].counters.to_map()["dropped"] == {"request": 1}


@pytest.mark.parametrize("data", [b"", _ID, _request(b"/other"), _ID + b"\xff\xff/cdff", bytes(1 << 17)])
def test_a_malformed_request_is_counted_and_dropped(
    relayed: RelayedRequests, node: _Node, types: RosTypes, data: bytes
) -> None:
    relayed.on_message(_message(types, data))
    relayed.on_message(b"\0\1\0\0\xff\xff\xff\xff")
    assert relayed.faults == 2
    assert relayed.last_fault
    relayed.close()
    assert node.published == []


def test_a_name_that_is_longer_than_its_message_is_refused() -> None:
    with pytest.raises(InputError, match="name of 9 bytes"):
        split_message(_ID + b"\x09\0/cdff")
