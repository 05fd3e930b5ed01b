# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway: the bus and the DDS domain of the robot, and what passes between them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from services.gateway_dds.relayed_requests import RelayedRequests
from services.gateway_dds.robot_node import RobotNode
from services.gateway_dds.settings import DdsSettings
from services.gateways.clock_topic import ClockTopic
from services.gateways.dpm_frames import DpmFrames
from services.gateways.frames import FrameNames, FrameTree
from services.gateways.input_links import links_by_topic
from services.gateways.inputs import InputLink
from services.gateways.outputs import connect_outputs
from services.gateways.status import status_of
from services.ros_messages.message_types import RosTypes

SERVICE = "gateway_dds"
#: Interval of the status, seconds.
_STATUS_S = 1.0


class Gateway:
    """Gateway between the bus and a robot with ROS 2 on DDS.

    Parameters
    ----------
    settings : DdsSettings
    bus : Bus
        Bus of CDFF.
    client : Client
        For requests; a connection to the bus of its own.
    """

    def __init__(self, settings: DdsSettings, bus: Bus, client: Client) -> None:
        self._settings, self._bus = settings, bus
        types = RosTypes(2)
        self.node = RobotNode(settings, types)
        names = FrameNames(settings.robot, settings.frames, settings.origins)
        self._tree = FrameTree()
        self._frames = DpmFrames(bus, settings.robot, self._tree)
        by_topic = links_by_topic(settings.inputs, names, types, bus, self._tree)
        self._inputs = [link for links in by_topic.values() for link in links]
        for topic, links in by_topic.items():
            entry = links[0].entry
            self.node.subscribe(topic, entry.type, entry.service_quality, _receiver(links), entry.queue)
        for link in self._inputs:
            quality = link.entry.service_quality
            for topic, type_name, receive, queue in link.further_topics:
                self.node.subscribe(topic, type_name, quality, receive, queue)
        self._outputs = connect_outputs(settings.outputs, names, types, self.node, bus, self._tree)
        self._clock = ClockTopic(bus.mission_clock, types, self.node) if settings.clock else None
        node_name = settings.node
        self._requests = RelayedRequests(settings.requests, node_name, names, types, self.node, client)
        self.node.start()

    def run(self, stop: threading.Event) -> None:
        """Publish the status every second until ``stop`` is set."""
        with ExitStack() as stack:
            for link in self._inputs:
                stack.callback(link.close)
            stack.callback(self._requests.close)
            stack.callback(self.node.close)
            self._frames.start(stop)
            if self._clock is not None:
                self._clock.start(self._bus.loops, stop)
            while True:
                self.node.check_types()
                self._bus.publish_latched(keys.gateway_status(self._settings.robot, SERVICE), self.status())
                if stop.wait(_STATUS_S):
                    return

    def status(self) -> dict[str, Any]:
        """Return the message of the status key: the counters of each topic, and the conflicts."""
        status = status_of(self._inputs, self._outputs, self._requests.requests)
        for name, count in self.node.not_plain.items():
            if name in status["inputs"]:
                status["inputs"][name]["dropped"]["encoding"] = count
        return {
            "node": self._settings.node,
            "domain": self._settings.domain,
            **status,
            "frame_tree": self._tree.to_map(),
            "conflicts": dict(self.node.conflicts),
            "relay": {"faults": self._requests.faults, "last_fault": self._requests.last_fault},
        }


def _receiver(links: list[InputLink]) -> Callable[[bytes], None]:
    """Return the callback of a subscription, which passes messages to links."""

    def receive(data: bytes) -> None:
        for link in links:
            link.on_message(data)

    return receive
