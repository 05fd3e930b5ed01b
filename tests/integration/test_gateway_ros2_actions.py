# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Goals that fail, results that are discarded, and requests for many parameters, over a real router."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus
from cdff_common.errors import UnavailableError
from services.gateway_ros2 import actions
from services.gateway_ros2.actions import ActionServer, Goal
from services.gateway_ros2.parameters import ParameterServer
from services.gateway_ros2.robot_node import RobotNode
from services.gateways.request_types import ACTIONS, REQUEST_ACTION
from services.ros_messages.message_types import RosTypes
from services.ros_messages.service_types import ActionType, ServiceType
from tests.integration.conftest import wait_until
from tests.integration.test_gateway_ros2_requests import Robot

pytestmark = pytest.mark.integration

_TYPES = RosTypes(2)
_NAME = "/cdff/request_product"
_SUCCEEDED, _ABORTED, _UNKNOWN = 4, 6, 0


@pytest.fixture
def buses(router: object, endpoint: str) -> Iterator[tuple[Bus, Bus]]:
    with (
        Bus.open(endpoint, name="gateway", wait_s=20.0) as server,
        Bus.open(endpoint, name="robot", wait_s=20.0) as client,
    ):
        yield server, client


def _result(success: bool) -> Any:
    kind = _TYPES.store.types["cdff_msgs/msg/Request_Result"]
    product = _TYPES.make(
        "infuse_msgs/Asn1Bitstream",
        header=_TYPES.header(0, ""),
        type="",
        serialization_method=0,
        data=np.zeros(0, np.uint8),
    )
    return kind(success=success, code="", message="", product_id="", metadata="", product=product)


class _Client:
    """A client of the action."""

    def __init__(self, bus: Bus) -> None:
        self.robot = Robot(bus)
        self.action = ActionType.register(
            self.robot.types, REQUEST_ACTION, ACTIONS[REQUEST_ACTION].definition
        )

    def send(self, number: int, query: str) -> bool:
        goal = self.robot.types.store.types["cdff_msgs/msg/Request_Goal"](query=query, deadline_s=0.0)
        answer = self.robot.call(
            f"{_NAME}/_action/send_goal", self.action.send_goal, goal_id=self._id(number), goal=goal
        )
        return bool(answer.accepted)

    def status(self, number: int) -> int:
        """Return the status in the result of a goal."""
        name, kind = f"{_NAME}/_action/get_result", self.action.get_result
        return int(self.robot.call(name, kind, timeout_s=5.0, goal_id=self._id(number)).status)

    def is_served(self) -> bool:
        try:
            return self.status(99) == _UNKNOWN
        except UnavailableError:
            return False

    def _id(self, number: int) -> Any:
        return self.robot.goal(np.full(16, number, np.uint8))


def _server(
    buses: tuple[Bus, Bus], execute: Callable[[Goal, Callable[[Any], None]], tuple[Any, bool]]
) -> _Client:
    node = RobotNode(buses[0], 0, "cdff_gateway", _TYPES)
    action = ActionType.register(_TYPES, REQUEST_ACTION, ACTIONS[REQUEST_ACTION].definition)
    ActionServer(node, _NAME, action, execute, lambda: _result(False))
    client = _Client(buses[1])
    wait_until(client.is_served, 10.0, "the action is served")
    return client


def test_an_error_aborts_a_goal_even_if_it_is_cancelled(buses: tuple[Bus, Bus]) -> None:
    def execute(goal: Goal, publish: Callable[[Any], None]) -> tuple[Any, bool]:
        if goal.request.query == "cancelled":
            goal.cancelled.set()
        if goal.request.query == "feedback":
            publish(None)
        raise RuntimeError("a fault of this test")

    client = _server(buses, execute)
    for number, query in enumerate(("fault", "cancelled", "feedback"), 1):
        assert client.send(number, query)
        assert client.status(number) == _ABORTED, query


def test_an_error_of_the_status_aborts_a_goal(
    buses: tuple[Bus, Bus], monkeypatch: pytest.MonkeyPatch
) -> None:
    publish, failures = ActionServer._publish_status, ["a fault of this test"]
    client = _server(buses, lambda goal, _: (_result(True), True))

    def fail_once(server: ActionServer) -> None:
        if threading.current_thread().name.startswith("goals of") and failures:
            raise RuntimeError(failures.pop())
        publish(server)

    monkeypatch.setattr(ActionServer, "_publish_status", fail_once)
    assert client.send(1, "first")
    assert client.status(1) == _ABORTED
    assert client.send(2, "second")
    assert client.status(2) == _SUCCEEDED


def test_a_result_that_cannot_be_encoded_is_refused_with_the_reason(buses: tuple[Bus, Bus]) -> None:
    client = _server(buses, lambda goal, _: (None, False))
    assert client.send(1, "nothing")
    with pytest.raises(UnavailableError, match="cannot be encoded"):
        client.status(1)


def test_the_results_that_ended_first_are_discarded_first(
    buses: tuple[Bus, Bus], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(actions, "_MAX_GOALS", 2)
    may_end = threading.Event()

    def execute(goal: Goal, _: Callable[[Any], None]) -> tuple[Any, bool]:
        if goal.request.query == "long":
            may_end.wait(20.0)
        return _result(True), True

    client = _server(buses, execute)
    assert client.send(1, "long")
    for number in (2, 3):
        assert client.send(number, "short")
        assert client.status(number) == _SUCCEEDED
    may_end.set()
    assert client.status(1) == _SUCCEEDED
    assert client.send(4, "short")
    assert [client.status(number) for number in (1, 2, 3)] == [_SUCCEEDED, _UNKNOWN, _SUCCEEDED]


def test_the_parameters_of_a_request_are_limited_and_a_refusal_without_text_is_no_success(
    buses: tuple[Bus, Bus], monkeypatch: pytest.MonkeyPatch
) -> None:
    server, bus = buses
    node = RobotNode(server, 0, "cdff_gateway", _TYPES)
    parameters = ParameterServer(node, "mana", {"position_manager": ("odometry.lidar_scale",)}, server)
    robot = Robot(bus)
    reading = robot.parameter_service("GetParameterTypes", "string[] names\n---\nuint8[] types\n")

    def types(count: int) -> list[int]:
        answer = robot.call("/cdff_gateway/get_parameter_types", reading, names=["no.such"] * count)
        return [int(v) for v in answer.types]

    def is_served() -> bool:
        try:
            return types(1) == [0]
        except UnavailableError:
            return False

    wait_until(is_served, 10.0, "the parameters are served")
    assert types(256) == [0] * 256
    with pytest.raises(UnavailableError, match="257 names: expected at most 256 in a request"):
        types(257)

    def refuse(_: object) -> None:
        raise LookupError

    monkeypatch.setattr(parameters._parameters, "set", refuse)
    setting: ServiceType = robot.parameter_service(
        "SetParametersAtomically", "Parameter[] parameters\n---\nSetParametersResult result\n"
    )
    answer = robot.call("/cdff_gateway/set_parameters_atomically", setting, parameters=[])
    assert not answer.result.successful
