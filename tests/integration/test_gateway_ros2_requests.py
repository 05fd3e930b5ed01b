# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A robot with ROS 2 requests products of a real DPM, and sets parameters of a DFPC."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from cdff_common.clock import wall_ns
from cdff_common.codecs import decode
from cdff_common.errors import UnavailableError
from cdff_dev.ports import free_port
from services.gateway_ros2 import rmw_zenoh
from services.gateways.request_types import ACTIONS, REQUEST_ACTION, REQUEST_SERVICE, SERVICES
from services.ros_messages.message_types import RosTypes
from services.ros_messages.service_types import ActionType, ServiceType
from services.ros_messages.type_hashes import message_hash
from tests.integration.conftest import ROOT, process_starter, wait_until
from tests.support.gateway_traffic import publish_navigation_map
from tests.support.orchestrated_products import patch, put

pytestmark = [pytest.mark.integration, pytest.mark.slow]

PROFILE = str(Path(__file__).parent / "ros2_requests.yaml")
_PAGE = (ROOT / "docs" / "how-to" / "ros2-requests.md").read_text(encoding="utf-8")
#: Settings with the requests and parameters of the page.
_SETTINGS = f"""
robot: mana
frames: {{map: site}}
outputs:
  - {{product: navigation_mapping/navigation_map, topic: /map, type: nav_msgs/msg/OccupancyGrid}}
{_PAGE.partition("```yaml")[2].partition("```")[0]}"""
_UUID = np.arange(1, 17, dtype=np.uint8)
_STATUS, _CANCEL = "action_msgs/msg/GoalStatusArray", "action_msgs/srv/CancelGoal"
_CANCEL_DEFINITION = "GoalInfo goal_info\n---\nint8 return_code\nGoalInfo[] goals_canceling\n"


ActionClient = tuple["Robot", ActionType, list[Any], list[Any]]


class Robot:
    """A program on the robot: calls services as ``rmw_zenoh`` does."""

    def __init__(self, bus: Bus) -> None:
        self.bus, self.types = bus, RosTypes(2)
        self._seq = 0

    def call(self, name: str, service: ServiceType, timeout_s: float = 30.0, **fields: Any) -> Any:
        self._seq += 1
        types, gid = self.types, bytes(range(16))
        request = types.store.types[service.request](**fields)
        reply = self.bus.foreign.call(
            rmw_zenoh.data_key(0, name, service.name, service.type_hash),
            bytes(types.serialize(request, service.request)),
            encoding="application/cdr",
            attachment=rmw_zenoh.Attachment(self._seq, wall_ns(), gid).to_bytes(),
            timeout_s=timeout_s,
        )
        attachment = rmw_zenoh.Attachment.from_bytes(reply.attachment)
        assert (attachment.seq, attachment.gid) == (self._seq, gid)
        return types.deserialize(reply.payload, service.response)

    def goal(self, uuid: Any) -> Any:
        return self.types.make("unique_identifier_msgs/UUID", uuid=np.asarray(uuid, np.uint8))

    def parameter_service(self, name: str, definition: str) -> ServiceType:
        return ServiceType.register(self.types, f"rcl_interfaces/srv/{name}", definition)


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A router, a DPM with two patches, an orchestrator, a DFPC and the gateway; yields the endpoint."""
    folder, endpoint = tmp_path_factory.mktemp("ros2"), f"tcp/127.0.0.1:{free_port()}"
    settings = folder / "gateway.yaml"
    settings.write_text(_SETTINGS)
    with process_starter(endpoint, folder) as spawn:
        spawn("services.router")
        spawn("services.dpm", "--profile", PROFILE, "--http", f"127.0.0.1:{free_port()}")
        spawn("services.orchestrator", "--profile", PROFILE)
        spawn("services.dfpc_host", "--profile", PROFILE, "--process", "mana_position_manager")
        spawn("services.gateway_ros2", "--settings", str(settings))
        with Bus.open(endpoint, name="producer", wait_s=20) as bus:
            names = ("dpm", "orchestrator", "position_manager", "gateway_ros2")
            awaited_tokens = {keys.alive("mana", s) for s in names}
            wait_until(lambda: awaited_tokens <= bus.alive(keys.alive("mana", "*")), 90, "start-up")
            put(bus, "dem", patch(0.0, 1.0, age_s=5000.0))
            put(bus, "dem", patch(1.0, 2.0, age_s=10.0))
        with Client(endpoint) as client:
            wait_until(lambda: _has_dem(client), 60, "the DPM has compiled its kernels")
        yield endpoint


def _has_dem(client: Client) -> bool:
    try:
        client.request("dem", robot="mana", region="bbox:0,0,2,2")
    except UnavailableError:
        return False
    return True


@pytest.fixture
def bus(stack: str) -> Iterator[Bus]:
    with Bus.open(stack, name="test") as bus:
        yield bus


def peer(*arguments: str) -> Any:
    """Run the peer program and return its JSON; skip without its environment."""
    default = ROOT / "build" / "ros2-peers" / "bin" / "python"
    python = os.environ.get("CDFF_ROS2_PEER_PYTHON", str(default))
    if not Path(python).exists():
        pytest.skip("zenoh-ros2-sdk is not installed; make peers installs it")
    command = [python, str(Path(__file__).with_name("ros2_sdk_peer.py")), *arguments]
    environment = {"PATH": os.environ["PATH"], "ROS_DOMAIN_ID": "0", "HOME": os.environ.get("HOME", "/")}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def test_another_implementation_has_the_latched_map_and_a_dem_by_a_service(bus: Bus, stack: str) -> None:
    publish_navigation_map(bus)
    found = peer(stack.rsplit(":", 1)[1])
    assert found["map"] == {"frame_id": "map", "size": [3, 2], "data": [100, 0, 0, -1, 0, 50]}
    dem = found["dem"]
    assert (dem["frame_id"], dem["layers"]) == ("map", ["mean", "count"])
    assert dem["lengths"] == pytest.approx([2.0, 1.0])
    assert dem["values"][0] == pytest.approx([1.0, 1.5])
    assert dem["values"][1] == pytest.approx([4.0, 8.0])


def test_hashes_are_those_of_ros2_pyterfaces() -> None:
    definitions = get_typestore(Stores.ROS2_KILTED).fielddefs
    hashes = {name: value for name, value in peer("--hashes").items() if name in definitions}
    assert len(hashes) > 140
    hashes.pop("sensor_msgs/msg/Range")  # ros2-pyterfaces has that of ROS 2 Humble
    assert {name: message_hash(definitions, name) for name in hashes} == hashes


def test_a_late_subscriber_has_the_map(bus: Bus) -> None:
    publish_navigation_map(bus)
    types = RosTypes(2)
    name = "nav_msgs/msg/OccupancyGrid"
    key = rmw_zenoh.data_key(0, "/map", name, message_hash(types.store.fielddefs, name))
    received: list[Any] = []
    bus.foreign.subscribe_cached(key, lambda m: received.append(types.deserialize(m.payload, name)))
    wait_until(lambda: received, 10.0, "the last map has arrived")
    assert received[0].info.origin.position.y == 1.0


def test_a_service_returns_a_product_and_refuses_others_with_the_reason(bus: Bus) -> None:
    robot = Robot(bus)
    service = ServiceType.register(robot.types, REQUEST_SERVICE, SERVICES[REQUEST_SERVICE].definition)
    query = "type=dem;region=bbox:0,0,1,1"
    answer = robot.call("/cdff/request", service, query=query, deadline_s=0.0)
    assert (answer.success, answer.message) == (True, "")
    assert answer.product.header.frame_id == "map"
    value = decode(answer.product.type, bytes(answer.product.data), "uper")
    np.testing.assert_allclose(value.layer("mean"), 1.0)
    assert json.loads(answer.metadata)["header"]["id"] == answer.product_id
    for query, code in (
        ("type=pose", "DENIED"),
        ("type=dem;robot=minnie", "INVALID_ARGUMENT"),
        ("type=dem;region=nowhere", "INVALID_ARGUMENT"),
        ("type=dem;region=bbox:500,500,501,501;min_coverage=0.5", "UNAVAILABLE"),
    ):
        refused = robot.call("/cdff/request", service, query=query, deadline_s=3.0)
        assert (refused.success, refused.code) == (False, code), refused.message
        assert refused.message
    key = rmw_zenoh.data_key(0, "/cdff/request", service.name, service.type_hash)
    with pytest.raises(UnavailableError, match="attachment of 3 bytes"):
        bus.foreign.call(key, b"\0\1\0\0", encoding="application/cdr", attachment=b"bad")
    attachment = rmw_zenoh.Attachment(1, 0, bytes(16)).to_bytes()
    truncated = bytes.fromhex("00010000ffffffff41")  # a text of 4 GB
    with pytest.raises(UnavailableError, match="9 bytes of cdff_msgs/srv/Request"):
        bus.foreign.call(key, truncated, encoding="application/cdr", attachment=attachment)

    def refusals() -> int:
        entries = bus.call(keys.gateway_status("mana", "gateway_ros2")).body()["requests"]
        return sum(r["dropped"].get("request", 0) for r in entries if r["name"] == "/cdff/request")

    wait_until(lambda: refusals() == 4, 5.0, "the status has the refusals")


@pytest.fixture
def action(bus: Bus) -> ActionClient:
    """A client of the action with the feedback and the status that it receives."""
    robot = Robot(bus)
    action = ActionType.register(robot.types, REQUEST_ACTION, ACTIONS[REQUEST_ACTION].definition)
    feedback: list[Any] = []
    status: list[Any] = []
    key = rmw_zenoh.data_key(0, f"{_ACTION}/feedback", action.feedback_type, action.feedback_hash)
    bus.subscribe(key, lambda m: feedback.append(robot.types.deserialize(m.payload, action.feedback)))
    status_hash = message_hash(robot.types.store.fielddefs, _STATUS)
    bus.foreign.subscribe_cached(
        rmw_zenoh.data_key(0, f"{_ACTION}/status", _STATUS, status_hash),
        lambda m: status.append(robot.types.deserialize(m.payload, _STATUS)),
    )
    return robot, action, feedback, status


_ACTION = "/cdff/request_product/_action"


def _send(robot: Robot, action: ActionType, uuid: Any, query: str) -> bool:
    goal_type = robot.types.store.types["cdff_msgs/msg/Request_Goal"]
    goal = goal_type(query=query, deadline_s=0.0)
    answer = robot.call(f"{_ACTION}/send_goal", action.send_goal, goal_id=robot.goal(uuid), goal=goal)
    return bool(answer.accepted)


def _state(status: list[Any], uuid: Any) -> int:
    entries = status[-1].status_list if status else []
    found = [int(e.status) for e in entries if bytes(e.goal_info.goal_id.uuid) == bytes(uuid)]
    return found[0] if found else 0


def test_an_action_has_feedback_and_a_result(action: ActionClient) -> None:
    robot, kind, feedback, status = action
    assert _send(robot, kind, _UUID, "type=dem;region=bbox:0,0,1,1")
    assert not _send(robot, kind, _UUID, "type=dem"), "a goal id is used once"
    result = robot.call(f"{_ACTION}/get_result", kind.get_result, goal_id=robot.goal(_UUID))
    assert (result.status, result.result.success) == (4, True)
    value = decode(result.result.product.type, bytes(result.result.product.data), "uper")
    np.testing.assert_allclose(value.layer("mean"), 1.0)
    assert all(bytes(message.goal_id.uuid) == bytes(_UUID) for message in feedback)
    wait_until(lambda: _state(status, _UUID) == 4, 10.0, "the status is succeeded")
    unknown = robot.call(f"{_ACTION}/get_result", kind.get_result, goal_id=robot.goal(_UUID[::-1]))
    assert (unknown.status, unknown.result.success) == (0, False)


def test_a_goal_is_cancelled_and_one_that_cannot_be_met_is_aborted(action: ActionClient) -> None:
    robot, kind, feedback, status = action
    cancel = ServiceType.register(robot.types, _CANCEL, _CANCEL_DEFINITION)
    uuid = np.full(16, 7, np.uint8)
    # No newer pose can appear: the DFPC that produces it has no samples.
    assert _send(robot, kind, uuid, "type=pose;max_age_s=0")
    wait_until(lambda: feedback, 20.0, "feedback")
    assert feedback[0].feedback.state
    assert bytes(feedback[0].goal_id.uuid) == bytes(uuid)

    def cancelled(goal_id: Any) -> Any:
        stamp = robot.types.make("builtin_interfaces/Time", sec=0, nanosec=0)
        info = robot.types.make("action_msgs/GoalInfo", goal_id=robot.goal(goal_id), stamp=stamp)
        return robot.call(f"{_ACTION}/cancel_goal", cancel, goal_info=info)

    answer = cancelled(uuid)
    assert answer.return_code == 0
    assert [bytes(g.goal_id.uuid) for g in answer.goals_canceling] == [bytes(uuid)]
    result = robot.call(f"{_ACTION}/get_result", kind.get_result, goal_id=robot.goal(uuid))
    assert (result.status, result.result.success) == (5, False)
    assert cancelled(uuid).return_code == 3, "the goal has ended"
    assert cancelled(np.full(16, 9)).return_code == 2, "no such goal"

    other = np.full(16, 8, np.uint8)
    assert _send(robot, kind, other, "type=dem;region=nowhere")
    result = robot.call(f"{_ACTION}/get_result", kind.get_result, goal_id=robot.goal(other))
    assert (result.status, result.result.code) == (6, "INVALID_ARGUMENT")
    wait_until(lambda: (_state(status, uuid), _state(status, other)) == (5, 6), 10.0, "the status of both")


def test_parameters_of_a_dfpc_are_listed_read_set_and_refused(bus: Bus) -> None:
    robot = Robot(bus)
    node, names = (
        "/cdff_gateway",
        ["position_manager.odometry.lidar_scale", "position_manager.odometry.max_gap_s"],
    )
    listing = robot.parameter_service(
        "ListParameters", "string[] prefixes\nuint64 depth\n---\nListParametersResult result\n"
    )
    found = robot.call(f"{node}/list_parameters", listing, prefixes=[], depth=0)
    assert list(found.result.names) == names
    reading = robot.parameter_service("GetParameters", "string[] names\n---\nParameterValue[] values\n")
    setting = robot.parameter_service(
        "SetParameters", "Parameter[] parameters\n---\nSetParametersResult[] results\n"
    )

    def values() -> list[tuple[int, float]]:
        answer = robot.call(f"{node}/get_parameters", reading, names=[*names, "position_manager.wheels"])
        return [(int(v.type), float(v.double_value)) for v in answer.values]

    def set_value(name: str, value: float) -> Any:
        empty = values_of_no_type(robot)
        content = robot.types.make(
            "rcl_interfaces/ParameterValue", **{**empty, "type": 3, "double_value": value}
        )
        parameter = robot.types.make("rcl_interfaces/Parameter", name=name, value=content)
        (result,) = robot.call(f"{node}/set_parameters", setting, parameters=[parameter]).results
        return result

    assert values() == [(3, 1.45), (3, 2.0), (0, 0.0)]
    assert set_value(names[0], 2.5).successful
    assert values()[0] == (3, 2.5)
    assert set_value(names[1], 4.0).successful
    assert values() == [(3, 2.5), (3, 4.0), (0, 0.0)]
    for name, value, reason in (
        (names[0], -1.0, "lidar_scale"),
        ("position_manager.clock.max_ahead_s", 1.0, "not among the parameters"),
    ):
        result = set_value(name, value)
        assert not result.successful
        assert reason in result.reason
    assert values() == [(3, 2.5), (3, 4.0), (0, 0.0)]
    bus.call(keys.dfpc_rpc("mana", "position_manager", "activate"))
    result = set_value(names[0], 1.0)
    assert not result.successful
    assert "position_manager is active" in result.reason


def values_of_no_type(robot: Robot) -> dict[str, Any]:
    return {
        "type": 0,
        "bool_value": False,
        "integer_value": 0,
        "double_value": 0.0,
        "string_value": "",
        "byte_array_value": np.zeros(0, np.uint8),
        "bool_array_value": np.zeros(0, bool),
        "integer_array_value": np.zeros(0, np.int64),
        "double_array_value": np.zeros(0),
        "string_array_value": [],
    }
