# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two nodes of ROS 1 exchange messages without a master; faults are named and end only their connection."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import pytest

from services.gateway_ros1.master import RemoteApi
from services.gateway_ros1.node import Ros1Node
from services.gateway_ros1.tcpros import Connection, encode_header
from services.ros_messages.encoding import Outgoing
from services.ros_messages.message_types import RosTypes
from services.ros_messages.service_types import ServiceType

_TYPES = RosTypes(1)
_STRING, _HEADER = "std_msgs/msg/String", "std_msgs/msg/Header"
_SET_BOOL = "bool data\n---\nbool success\nstring message\n"


def _wait(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def _node(name: str) -> Ros1Node:
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    node = Ros1Node(f"http://127.0.0.1:{port}", "127.0.0.1", name, _TYPES)
    node.start()
    return node


@pytest.fixture
def publisher() -> Iterator[Ros1Node]:
    node = _node("/publisher")
    node.declare_publisher("/chatter", _STRING, latched=True)
    yield node
    node.close()


@pytest.fixture
def subscriber() -> Iterator[Ros1Node]:
    node = _node("/subscriber")
    yield node
    node.close()


def _subscribe(node: Ros1Node, uri: str, max_bytes: int = 1000, kind: str = _STRING) -> tuple[Any, Any]:
    received: list[str] = []
    faults: list[tuple[str, str]] = []
    node.subscribe(
        "/chatter",
        kind,
        lambda data: received.append(_TYPES.deserialize(data, kind).data),
        lambda reason, detail: faults.append((reason, detail)),
        max_bytes=max_bytes,
    )
    node.update_publishers("/chatter", [uri])
    return received, faults


def _say(node: Ros1Node, text: str) -> None:
    node.publish(Outgoing("/chatter", _STRING, _TYPES.make("std_msgs/String", data=text)), latched=True)


def test_a_late_subscriber_has_the_latched_message_and_the_following(
    publisher: Ros1Node, subscriber: Ros1Node
) -> None:
    _say(publisher, "before")
    received, faults = _subscribe(subscriber, publisher._slave.uri)
    _wait(lambda: received == ["before"])
    _say(publisher, "after")
    _wait(lambda: received == ["before", "after"])
    assert not faults
    api = RemoteApi(publisher._slave.uri, "/test")
    assert api.call("getPublications") == [["/chatter", "std_msgs/String"]]
    (row,) = api.call("getBusInfo")
    assert row[1:] == ["/subscriber", "o", "TCPROS", "/chatter", True]


def test_a_wrong_sum_is_refused_in_the_handshake(publisher: Ros1Node, subscriber: Ros1Node) -> None:
    received, faults = _subscribe(subscriber, publisher._slave.uri, kind=_HEADER)
    _wait(lambda: faults)
    assert faults[0][0] == "type"
    assert "md5sum" in faults[0][1]
    assert not received


def test_a_message_that_is_too_large_ends_its_connection_which_is_made_again(
    publisher: Ros1Node, subscriber: Ros1Node
) -> None:
    received, faults = _subscribe(subscriber, publisher._slave.uri, max_bytes=100)
    _wait(publisher.connections)
    _say(publisher, "x" * 200)
    _wait(lambda: faults)
    assert faults[0][0] == "size"
    _say(publisher, "short")
    _wait(lambda: received == ["short"])


def test_a_length_of_4_gb_is_not_allocated(subscriber: Ros1Node) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        connected = socket.create_connection(server.getsockname())
        sock, _ = server.accept()
        with connected, sock:
            sock.sendall(b"\xff\xff\xff\xff")
            with pytest.raises(ValueError, match="message of 4294967295 bytes"):
                _receive(Connection(connected))


def _receive(connection: Connection) -> None:
    try:
        connection.receive(1 << 20)
    except Exception as error:
        raise ValueError(str(error)) from error


@pytest.mark.parametrize(
    "data", [b"", b"\xff" * 64, b"\x04\x00\x00\x00\x00\x00\x00\x00", encode_header({"topic": "/other"})]
)
def test_bytes_that_are_no_header_do_not_stop_the_node(
    publisher: Ros1Node, subscriber: Ros1Node, data: bytes
) -> None:
    with socket.create_connection(publisher.address()) as sock:
        sock.sendall(data)
    _say(publisher, "still here")
    received, _ = _subscribe(subscriber, publisher._slave.uri)
    _wait(lambda: received == ["still here"])


def test_a_service_answers_and_names_faults(publisher: Ros1Node) -> None:
    service = ServiceType.register(_TYPES, "std_srvs/srv/SetBool", _SET_BOOL)
    response = _TYPES.store.types[service.response]
    publisher.serve("/arm", service, lambda request: response(success=request.data, message="armed"))
    fields = {"callerid": "/test", "service": "/arm", "persistent": "1"}

    def ask(md5: str, *requests: bytes) -> tuple[dict[str, str], list[tuple[bytes, bytes]]]:
        connection = Connection.open(*publisher.address())
        connection.wait(10.0)
        connection.send_header({**fields, "md5sum": md5})
        header, answers = connection.receive_header(), []
        for request in requests:
            connection.send(request)
            answers.append((connection.receive_exactly(1), connection.receive(1000)))
        connection.close()
        return header, answers

    header, answers = ask("09fb03525b03e7ea1fd3992bafd87e16", b"\1", b"")
    assert header["type"] == "std_srvs/SetBool"
    assert answers[0] == (b"\1", b"\x01\x05\x00\x00\x00armed")
    assert answers[1][0] == b"\0"
    assert b"0 bytes of std_srvs/srv/SetBool" in answers[1][1]
    refused, _ = ask("0" * 32)
    assert "expected 09fb03525b03e7ea1fd3992bafd87e16" in refused["error"]


def test_a_node_answers_the_calls_of_tools(publisher: Ros1Node) -> None:
    api = RemoteApi(publisher._slave.uri, "/test")
    host, port = publisher.address()
    assert api.call("requestTopic", "/chatter", [["TCPROS"]]) == ["TCPROS", host, port]
    assert api.call("getMasterUri") == publisher.master_uri
    assert isinstance(api.call("getPid"), int)
    with pytest.raises(Exception, match="/nothing is not published"):
        api.call("requestTopic", "/nothing", [["TCPROS"]])
    with pytest.raises(Exception, match="expected the protocol TCPROS"):
        api.call("requestTopic", "/chatter", [["UDPROS"]])
    assert urlsplit(publisher._slave.uri).hostname == "127.0.0.1"


def test_closing_ends_the_threads(publisher: Ros1Node) -> None:
    before = threading.active_count()
    node = _node("/short")
    _subscribe(node, publisher._slave.uri)
    node.close()
    _wait(lambda: threading.active_count() <= before + 1)
