# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway: two connections, to the bus and to the router of the robot, and the topics between them."""

from __future__ import annotations

import logging
import threading
from contextlib import ExitStack
from typing import Any

from cdff_common.bus import Bus, Message, keys
from services.gateway_ros2 import rmw_zenoh
from services.gateway_ros2.inputs import InputLink
from services.gateway_ros2.outputs import FrameTree, OutputLink, Publishers
from services.gateway_ros2.settings import GatewaySettings
from services.ros_messages.conversions import CAMERA_INFO
from services.ros_messages.message_types import RosTypes
from services.ros_messages.type_hashes import message_hash

logger = logging.getLogger(__name__)

SERVICE = "gateway_ros2"
#: Interval of the status, seconds.
_STATUS_S = 1.0


class Gateway:
    """Gateway between the bus and a robot with ``rmw_zenoh``.

    Parameters
    ----------
    settings : GatewaySettings
    bus : Bus
        Bus of CDFF.
    robot_bus : Bus
        Connection to the router of the robot.
    """

    def __init__(self, settings: GatewaySettings, bus: Bus, robot_bus: Bus) -> None:
        self._settings, self._bus, self._robot_bus = settings, bus, robot_bus
        self._types = RosTypes(2)
        self._node = rmw_zenoh.Node(settings.domain, robot_bus.zid, settings.node)
        self._type_conflicts: dict[str, str] = {}
        self._entities = 0
        self._inputs = [
            InputLink(entry, settings.robot, settings.frames, self._types, self._hash(entry.type), bus)
            for entry in settings.inputs
        ]
        robot_bus.declare_token(self._node.token)
        self._subscriptions: dict[str, Any] = {}
        for link in self._inputs:
            entry = link.entry
            self._subscribe(entry.topic, entry.type, entry.qos, link.on_message, entry.queue)
            if entry.camera_info is not None:
                self._subscribe(entry.camera_info, CAMERA_INFO, entry.qos, link.on_camera_info, 1)
        publishers = Publishers(robot_bus, self._node, self._types, self._entities + 1)
        frame_tree = FrameTree()
        self._outputs = [
            OutputLink(entry, settings.robot, settings.frames, self._types, publishers, frame_tree)
            for entry in settings.outputs
        ]
        for output in self._outputs:
            # Images have topics below the listed one, which are declared with the first image.
            if output.entry.type not in ("sensor_msgs/msg/Image",):
                publishers.declare(output.entry.topic, output.entry.type)
            dfpc, port = output.entry.product.split("/")
            bus.subscribe(keys.product(settings.robot, dfpc, port), output.on_message)
        robot_bus.watch_alive(f"@ros2_lv/{settings.domain}/*/*/*/MP/**", self._on_publisher)

    def run(self, stop: threading.Event) -> None:
        """Publish the status every second until ``stop`` is set."""
        with ExitStack() as stack:
            for link in self._inputs:
                stack.callback(link.close)
            while True:
                key = keys.gateway_status(self._settings.robot, SERVICE)
                self._bus.publish_latched(key, self.status())
                if stop.wait(_STATUS_S):
                    return

    def status(self) -> dict[str, Any]:
        """Return the message of the status key: the counters of each topic."""
        inputs = {}
        for link in self._inputs:
            counters = link.counters.to_map()
            overflow = self._subscriptions[link.entry.topic].dropped
            if overflow:
                counters["dropped"]["queue"] = overflow
            busy = link.sensor.status.dropped
            if busy:
                counters["dropped"]["bus"] = busy
            inputs[link.entry.topic] = {"type": link.entry.type, "stream": link.entry.stream, **counters}
        outputs = [
            {"product": o.entry.product, "topic": o.entry.topic, "type": o.entry.type, **o.counters.to_map()}
            for o in self._outputs
        ]
        conflicts = dict(self._type_conflicts)
        return {"node": self._node.name, "inputs": inputs, "outputs": outputs, "type_conflicts": conflicts}

    def _hash(self, type_name: str) -> str:
        return message_hash(self._types.store.fielddefs, type_name)

    def _subscribe(self, topic: str, type_name: str, qos: str, callback: Any, depth: int) -> None:
        self._entities += 1
        qos_text = rmw_zenoh.QOS_SENSOR_DATA if qos == "sensor_data" else rmw_zenoh.QOS_DEFAULT
        token = self._node.entity_token(
            self._entities, "MS", topic, type_name, self._hash(type_name), qos_text
        )
        self._robot_bus.declare_token(token)
        key = rmw_zenoh.data_key(self._node.domain, topic, type_name, "*")

        def receive(message: Message) -> None:
            callback(message)

        self._subscriptions[topic] = self._robot_bus.subscribe(key, receive, depth=depth)

    def _on_publisher(self, token: str, is_alive: bool) -> None:
        """Compare the type of a publisher of the robot with that of the settings."""
        chunks = token.split("/")
        if len(chunks) != 13:
            return
        topic, kind = chunks[9].replace("%", "/"), chunks[10]
        expected = {link.entry.topic: link.entry.type for link in self._inputs}
        if topic not in expected or kind == rmw_zenoh.dds_type(expected[topic]):
            return
        if is_alive:
            self._type_conflicts[topic] = kind
            logger.warning("%s: published as %s, expected %s", topic, kind, expected[topic])
        else:
            self._type_conflicts.pop(topic, None)
