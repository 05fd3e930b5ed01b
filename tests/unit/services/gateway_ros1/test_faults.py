# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faulty masters, publishers and clients of ROS 1: each fault is counted, and the node continues."""

from __future__ import annotations

import http.client
import logging
import socket
import socketserver
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import pytest

from cdff_common.errors import ConfigurationError, UnavailableError
from services.gateway_ros1 import node as node_module
from services.gateway_ros1 import service as service_module
from services.gateway_ros1 import subscription as subscription_module
from services.gateway_ros1 import tcpros
from services.gateway_ros1.__main__ import parse_arguments
from services.gateway_ros1.master import RemoteApi
from services.gateway_ros1.node import Ros1Node
from services.gateway_ros1.tcpros import Connection
from services.ros_messages.encoding import Outgoing
from services.ros_messages.md5_sums import service_md5
from services.ros_messages.message_types import RosTypes
from services.ros_messages.service_types import ServiceType
from tests.support.ros1_master import Master

_TYPES = RosTypes(1)
_STRING = "std_msgs/msg/String"
_SET_BOOL = "bool data\n---\nbool success\nstring message\n"
_INT_OF_40_BITS = (
    b"<methodResponse><params><param><value><array><data><value><int>1</int></value><value></value>"
    b"<value><i8>1099511627776</i8></value></data></array></value></param></params></methodResponse>"
)


def _wait(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + 15.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


@pytest.fixture
def master() -> Iterator[Master]:
    with Master() as master:
        yield master


@pytest.fixture
def node(master: Master, monkeypatch: pytest.MonkeyPatch) -> Iterator[Ros1Node]:
    monkeypatch.setattr(node_module, "_CHECK_S", 0.05)
    node = Ros1Node(master.uri, "127.0.0.1", "/gateway", _TYPES)
    yield node
    node.close()


@pytest.mark.parametrize("host", ["", "0.0.0.0", "0", "::", "no such host", "192.0.2.1"])
def test_a_host_that_is_not_one_address_of_this_machine_is_refused(host: str) -> None:
    with pytest.raises(ConfigurationError, match=r"expected .* address .*--host or ROS_IP"):
        Ros1Node("http://127.0.0.1:1", host, "/gateway", _TYPES)


def test_an_address_that_the_nodes_of_the_master_cannot_reach_is_refused() -> None:
    with pytest.raises(
        ConfigurationError, match=r"the master is at 192\.0\.2\.1, and its nodes cannot reach"
    ):
        Ros1Node("http://192.0.2.1:11311", "127.0.0.1", "/gateway", _TYPES)


def test_empty_variables_of_the_environment_are_as_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_IP", "")
    monkeypatch.setenv("ROS_MASTER_URI", "")
    arguments = parse_arguments(["--settings", "gateway.yaml"])
    assert (arguments.host, arguments.master) == ("127.0.0.1", "http://127.0.0.1:11311")


@pytest.mark.parametrize("method", ["getPid", "registerSubscriber", "subscribeParam"])
@pytest.mark.parametrize(
    "answer", [b"", b"<methodResponse>", b"<not xml", b"\xff\xfe", b"</methodResponse>", b"<a/>"]
)
def test_an_answer_of_the_master_that_is_not_xml_rpc_is_counted_and_the_call_repeated(
    master: Master, node: Ros1Node, method: str, answer: bytes
) -> None:
    node.subscribe("/chatter", _STRING, lambda _: None, lambda *_: None, max_bytes=100)
    node.watch_parameter("/speed", lambda _: None)
    master.raw[method] = answer
    node.start()
    _wait(lambda: node.master_faults)
    assert method in node.last_master_fault
    assert not node.is_registered
    del master.raw[method]
    _wait(lambda: node.is_registered)
    assert node.problem() == ""


@pytest.mark.parametrize("value", [5, True, "uris", {"a": 1}])
def test_publishers_that_are_no_list_are_counted(master: Master, node: Ros1Node, value: object) -> None:
    node.subscribe("/chatter", _STRING, lambda _: None, lambda *_: None, max_bytes=100)
    master.values["registerSubscriber"] = value
    node.start()
    _wait(lambda: node.master_faults)
    assert "expected a list of publishers" in node.last_master_fault
    master.values.clear()
    _wait(lambda: node.is_registered)


def test_a_value_that_xml_rpc_cannot_express_is_a_failed_call(master: Master) -> None:
    master.raw["getParam"] = _INT_OF_40_BITS
    api = RemoteApi(master.uri, "/gateway")
    assert api.call("getParam", "/speed") == 1 << 40
    with pytest.raises(UnavailableError, match="setParam"):
        api.call("setParam", "/speed", 1 << 40)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_has_ended_is_a_problem_of_the_process(master: Master, node: Ros1Node) -> None:
    def fail(_: object) -> None:
        raise RuntimeError("a fault of this test")

    node.watch_parameter("/speed", fail)
    master.parameters["/speed"] = 1.0
    assert node.problem() == ""
    node.start()
    _wait(node.problem)
    assert node.problem() == "the thread 'master' of the node /gateway has ended"


def test_an_xml_rpc_server_that_has_ended_is_a_problem_of_the_process(master: Master) -> None:
    node = Ros1Node(master.uri, "127.0.0.1", "/gateway", _TYPES)
    assert node.problem() == ""
    node._slave._server.shutdown()
    _wait(node.problem)
    assert node.problem() == "the thread 'slave api' of the node /gateway has ended"
    node.close()
    assert node.problem() == ""


def _subscribe(node: Ros1Node, receive: Callable[[str], None]) -> list[tuple[str, str]]:
    faults: list[tuple[str, str]] = []
    node.subscribe(
        "/chatter",
        _STRING,
        lambda data: receive(_TYPES.deserialize(data, _STRING).data),
        lambda *fault: faults.append(fault),
        max_bytes=1000,
    )
    return faults


def _say(node: Ros1Node, text: str) -> None:
    node.publish(Outgoing("/chatter", _STRING, _TYPES.make("std_msgs/String", data=text)), latched=True)


@pytest.mark.parametrize(
    "address", [["host." + 70 * "x", 1], ["127.0.0.1", "port"], ["127.0.0.1", 70_000], ["127.0.0.1", []]]
)
def test_a_publisher_that_states_no_address_is_counted_and_tried_again(
    master: Master, node: Ros1Node, address: list[Any]
) -> None:
    received: list[str] = []
    faults = _subscribe(node, received.append)
    publisher = Ros1Node(master.uri, "127.0.0.1", "/publisher", _TYPES)
    publisher.start()
    publisher.declare_publisher("/chatter", _STRING, latched=True)
    _say(publisher, "hello")
    master.values["requestTopic"] = ["TCPROS", *address]
    node.update_publishers("/chatter", [master.uri])
    _wait(lambda: len(faults) > 1)
    assert {reason for reason, _ in faults} == {"address"}
    master.values["requestTopic"] = ["TCPROS", *publisher.address()]
    _wait(lambda: received == ["hello"])
    publisher.close()


def test_a_message_that_cannot_be_processed_is_counted_and_the_publisher_connected_again(
    master: Master, node: Ros1Node
) -> None:
    received: list[str] = []

    def receive(text: str) -> None:
        received.append(text)
        if len(received) == 1:
            text.encode("ascii")

    faults = _subscribe(node, receive)
    publisher = Ros1Node(master.uri, "127.0.0.1", "/publisher", _TYPES)
    publisher.start()
    _say(publisher, "grün")
    node.update_publishers("/chatter", [publisher._slave.uri])
    _wait(lambda: received == ["grün", "grün"])
    ((reason, detail),) = faults
    assert reason == "content"
    assert "UnicodeEncodeError" in detail
    publisher.close()


def test_publishers_of_a_topic_are_limited_and_each_is_connected_once(
    node: Ros1Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    faults = _subscribe(node, lambda _: None)
    node.update_publishers("/chatter", ["http://127.0.0.1:1"] * 3)
    assert node._subscriptions["/chatter"].peers() == ["http://127.0.0.1:1"]
    assert not faults
    monkeypatch.setattr(subscription_module, "_MAX_PUBLISHERS", 4)
    node.update_publishers("/chatter", [f"http://127.0.0.1:{i}" for i in range(1, 10)])
    assert len(node._subscriptions["/chatter"].peers()) == 4
    assert faults == [("publishers", "9 publishers: expected at most 4")]


def _post(node: Ros1Node, headers: dict[str, str], body: bytes = b"") -> int:
    connection = http.client.HTTPConnection(urlsplit(node._slave.uri).netloc, timeout=10.0)
    connection.putrequest("POST", "/RPC2")
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    connection.send(body)
    status = connection.getresponse().status
    connection.close()
    return status


def test_calls_that_are_too_large_or_compressed_are_refused(node: Ros1Node) -> None:
    assert _post(node, {"content-length": str((1 << 20) + 1)}) == 413
    assert _post(node, {"content-length": "9" * 5000}) == 413
    assert _post(node, {"content-length": "0" * 20 + "9" * 9}) == 413
    assert _post(node, {"content-length": "-1"}) == 411
    assert _post(node, {}) == 411
    assert _post(node, {"content-length": "3", "content-encoding": "gzip"}) == 415
    assert isinstance(RemoteApi(node._slave.uri, "/test").call("getPid"), int)


def test_the_threads_for_calls_are_limited(node: Ros1Node) -> None:
    address = urlsplit(node._slave.uri)
    before = threading.active_count()
    idle = [socket.create_connection((address.hostname, address.port)) for _ in range(50)]
    _wait(lambda: threading.active_count() == before + 32)
    idle[-1].settimeout(10.0)
    assert idle[-1].recv(1) == b"", "the connection is closed"
    for sock in idle:
        sock.close()
    _wait(lambda: threading.active_count() == before)
    assert isinstance(RemoteApi(node._slave.uri, "/test").call("getPid"), int)


def test_a_call_for_which_no_thread_can_start_occupies_no_place(
    node: Ros1Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("can't start new thread")

    api = RemoteApi(node._slave.uri, "/test")
    with monkeypatch.context() as patch:
        patch.setattr(socketserver.ThreadingMixIn, "process_request", fail)
        for _ in range(40):
            with pytest.raises(UnavailableError):
                api.call("getPid")
    assert isinstance(api.call("getPid"), int)


def test_an_unexpected_error_of_a_service_is_answered_and_its_connection_remains(
    node: Ros1Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = ServiceType.register(_TYPES, "std_srvs/srv/SetBool", _SET_BOOL)
    response = _TYPES.store.types[service.response]

    def handle(request: Any) -> Any:
        if not request.data:
            raise RuntimeError("a fault of this test")
        return response(success=True, message="")

    node.serve("/arm", service, handle)
    node.start()
    monkeypatch.setattr(service_module, "_IDLE_S", 0.5)
    connection = Connection.open(*node.address())
    md5 = service_md5(_TYPES, service.request, service.response)
    connection.send_header({"callerid": "/test", "service": "/arm", "persistent": "1", "md5sum": md5})
    assert "error" not in connection.receive_header()
    connection.send(b"\0")
    assert connection.receive_exactly(1) == b"\0"
    assert connection.receive(1000) == b"RuntimeError: a fault of this test"
    connection.send(b"\1")
    assert connection.receive_exactly(1) == b"\1"
    connection.receive(1000)
    with pytest.raises(EOFError):  # idle
        connection.receive_exactly(1)
    connection.close()


def test_a_slow_subscriber_is_reported_and_its_connection_ends_when_it_takes_nothing(
    node: Ros1Node, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(tcpros, "_SEND_TIMEOUT", tcpros.struct.pack("ll", 1, 0))
    node.declare_publisher("/chatter", _STRING, latched=False)
    node.start()
    with Connection.open(*node.address())._sock as sock:
        assert sock.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
        slow = Connection(sock)
        slow.send_header({"callerid": "/slow", "topic": "/chatter", "md5sum": "*"})
        slow.receive_header()
        _wait(lambda: node._publications["/chatter"].peers() == ["/slow"])
        with caplog.at_level(logging.WARNING):
            for _ in range(40):
                _say(node, "x" * (1 << 20))
        assert node.dropped("/chatter") > 0
        assert node.dropped("/chat") == 0
        assert node.dropped("", ["", "/other"]) == node.dropped("/chatter")
        assert node.dropped("", ["", "/chatter"]) == 0  # counted for the topic below
        (line,) = [r.getMessage() for r in caplog.records if "too slow" in r.getMessage()]
        assert line.startswith("/chatter: /slow is too slow")
        _wait(lambda: node._publications["/chatter"].peers() == [])
