# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway: two connections, to the bus and to the router of the robot, and what passes between them."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from typing import Any

from cdff_common.bus import Bus, Message, Subscription, keys
from cdff_common.client import Client
from cdff_common.errors import CdffError
from services.gateway_ros2 import rmw_zenoh
from services.gateway_ros2.actions import ActionServer, Goal
from services.gateway_ros2.parameters import ParameterServer
from services.gateway_ros2.robot_node import RobotNode
from services.gateway_ros2.settings import Ros2Settings
from services.gateways.clock_topic import ClockTopic
from services.gateways.dpm_frames import DpmFrames
from services.gateways.frames import FrameNames, FrameTree
from services.gateways.input_links import links_by_topic
from services.gateways.inputs import InputLink
from services.gateways.outputs import connect_outputs
from services.gateways.request_types import ACTIONS, SERVICES
from services.gateways.requests import ProductRequests
from services.gateways.settings import RequestEntry
from services.gateways.status import status_of
from services.ros_messages.message_types import RosTypes
from services.ros_messages.service_types import ActionType, ServiceType

logger = logging.getLogger(__name__)

SERVICE = "gateway_ros2"
#: Interval of the status, seconds.
_STATUS_S = 1.0
#: Threads of a service for requests.
_REQUEST_WORKERS = 4
#: An input, and the function that takes the messages of one of its topics.
_Receiver = tuple[InputLink, Callable[[bytes], None]]


class Gateway:
    """Gateway between the bus and a robot with ``rmw_zenoh``.

    Parameters
    ----------
    settings : Ros2Settings
    bus : Bus
        Bus of CDFF.
    robot_bus : Bus
        Connection to the router of the robot.
    client : Client
        For requests; a connection to the bus of its own.
    """

    def __init__(self, settings: Ros2Settings, bus: Bus, robot_bus: Bus, client: Client) -> None:
        self._settings, self._bus, self._client = settings, bus, client
        self._types = RosTypes(2)
        self._node = RobotNode(robot_bus, settings.domain, settings.node, self._types)
        self._names = FrameNames(settings.robot, settings.frames, settings.origins)
        self._tree = FrameTree()
        self._frames = DpmFrames(bus, settings.robot, self._tree)
        self._clock = ClockTopic(bus.mission_clock, self._types, self._node) if settings.clock else None
        self._type_conflicts: dict[str, str] = {}
        self._subscriptions: dict[str, Subscription] = {}
        self._inputs = self._make_inputs()
        self._outputs = connect_outputs(
            settings.outputs, self._names, self._types, self._node, bus, self._tree
        )
        self._actions: list[ActionServer] = []
        self._requests = [self._serve(entry) for entry in settings.requests]
        self._parameters = ParameterServer(self._node, settings.robot, settings.parameters, bus)
        robot_bus.watch_alive(f"@ros2_lv/{settings.domain}/*/*/*/MP/**", self._on_publisher)

    def run(self, stop: threading.Event) -> None:
        """Publish the status every second until ``stop`` is set."""
        with ExitStack() as stack:
            for link in self._inputs:
                stack.callback(link.close)
            for action in self._actions:
                stack.callback(action.close)
            self._frames.start(stop)
            if self._clock is not None:
                self._clock.start(self._bus.loops, stop)
            while True:
                key = keys.gateway_status(self._settings.robot, SERVICE)
                self._bus.publish_latched(key, self.status())
                if stop.wait(_STATUS_S):
                    return

    def status(self) -> dict[str, Any]:
        """Return the message of the status key: the counters of each topic."""
        links = status_of(
            self._inputs,
            self._outputs,
            self._requests,
            lambda link: self._subscriptions[link.entry.topic].dropped,
        )
        return {
            "node": self._node.node.name,
            **links,
            "frame_tree": self._tree.to_map(),
            "parameters": self._parameters.to_map(),
            "type_conflicts": dict(self._type_conflicts),
        }

    def _make_inputs(self) -> list[InputLink]:
        by_topic = links_by_topic(self._settings.inputs, self._names, self._types, self._bus, self._tree)
        links = [link for same in by_topic.values() for link in same]
        for topic, same in by_topic.items():
            entry = same[0].entry
            receivers: list[_Receiver] = [(link, link.on_message) for link in same]
            self._subscriptions[topic] = self._subscribe(topic, entry.type, receivers, entry.queue)
        for link in links:
            for further in link.further_topics:
                receivers = [(link, further.receive)]
                self._subscribe(further.topic, further.type_name, receivers, further.queue)
        return links

    def _subscribe(
        self, topic: str, type_name: str, receivers: Sequence[_Receiver], queue: int
    ) -> Subscription:
        receive = _receiving(receivers, self._node, type_name)
        quality = receivers[0][0].entry.service_quality
        return self._node.subscribe(topic, type_name, quality, receive, queue)

    def _serve(self, entry: RequestEntry) -> ProductRequests:
        """Declare the service or action of an entry."""
        types = self._types
        if entry.type in SERVICES:
            service = ServiceType.register(types, entry.type, SERVICES[entry.type].definition)
            requests = ProductRequests(entry, service.response, self._names, types, self._client)

            def handle(request: Any, respond: Callable[[Any], None]) -> None:
                respond(requests.answer(request))

            self._node.serve(entry.name, service, handle, workers=_REQUEST_WORKERS)
            return requests
        action = ActionType.register(types, entry.type, ACTIONS[entry.type].definition)
        result = action.name.replace("/action/", "/msg/") + "_Result"
        requests = ProductRequests(entry, result, self._names, types, self._client)
        feedback_type = types.store.types[action.name.replace("/action/", "/msg/") + "_Feedback"]

        def execute(goal: Goal, publish: Callable[[Any], None]) -> tuple[Any, bool]:
            job = ""

            def cancel() -> None:
                with suppress(CdffError):  # the request has ended
                    if job:
                        requests.cancel(job)

            def on_progress(body: Any) -> None:
                nonlocal job
                job = str(body.get("job", ""))
                fields = {name: str(body.get(name) or "") for name in ("state", "reason")}
                publish(feedback_type(**fields, remaining_s=float(body.get("remaining_s") or 0.0)))
                if goal.cancelled.is_set():
                    cancel()

            goal.cancel = cancel
            answer = requests.answer(goal.request, on_progress)
            return answer, bool(answer.success)

        self._actions.append(ActionServer(self._node, entry.name, action, execute, requests.no_answer))
        return requests

    def _on_publisher(self, token: str, is_alive: bool) -> None:
        """Compare the type of a publisher of the robot with that of the settings."""
        chunks = token.split("/")
        if len(chunks) != 13:
            return
        topic, kind = chunks[9].replace("%", "/"), chunks[10]
        expected = {topic: link.entry.type for link in self._inputs for topic in link.entry.topics}
        if topic not in expected or kind == rmw_zenoh.dds_type(expected[topic]):
            return
        if is_alive:
            self._type_conflicts[topic] = kind
            logger.warning("%s: published as %s, expected %s", topic, kind, expected[topic])
        else:
            self._type_conflicts.pop(topic, None)


def _receiving(receivers: Sequence[_Receiver], node: RobotNode, type_name: str) -> Callable[[Message], None]:
    """Return the callback of a subscription, which passes messages of the right type to links."""
    type_hash = node.hash_of(type_name)

    def receive(message: Message) -> None:
        if node.is_own(message.attachment):
            return
        found = message.key.rpartition("/")[2]
        for link, take in receivers:
            if found not in (type_hash, rmw_zenoh.NO_HASH):
                link.counters.receive(len(message.payload))
                link.drop("type_hash", f"type hash {found}, expected {type_hash} of {type_name}")
            else:
                take(message.payload)

    return receive
