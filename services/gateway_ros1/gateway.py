# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to ROS 1: a node of the robot, the bus, and what passes between them."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from services.gateway_ros1.node import Ros1Node
from services.gateway_ros1.parameters import ServerParameters
from services.gateway_ros1.settings import Ros1Settings
from services.gateways.clock_topic import ClockTopic
from services.gateways.dfpc_parameters import DfpcParameters
from services.gateways.dpm_frames import DpmFrames
from services.gateways.frames import FrameNames, FrameTree
from services.gateways.input_links import links_by_topic
from services.gateways.inputs import FurtherTopic, InputLink
from services.gateways.outputs import connect_outputs
from services.gateways.request_types import SERVICES
from services.gateways.requests import ProductRequests
from services.gateways.settings import RequestEntry
from services.gateways.status import status_of
from services.ros_messages.message_types import RosTypes
from services.ros_messages.service_types import ServiceType

logger = logging.getLogger(__name__)

SERVICE = "gateway_ros1"
_STATUS_S = 1.0


class Gateway:
    """Gateway between the bus and a robot with ROS 1.

    Parameters
    ----------
    settings : Ros1Settings
    bus : Bus
        Bus of CDFF.
    client : Client
        For requests; a connection to the bus of its own.
    master_uri : str
    host : str
        Address of this machine for the robot.
    """

    def __init__(self, settings: Ros1Settings, bus: Bus, client: Client, master_uri: str, host: str) -> None:
        self._settings, self._bus, self._client = settings, bus, client
        self._types = RosTypes(1)
        self._node = Ros1Node(master_uri, host, f"/{settings.node}", self._types)
        self._names = FrameNames(settings.robot, settings.frames, settings.origins)
        self._tree = FrameTree()
        self._frames = DpmFrames(bus, settings.robot, self._tree)
        self._inputs = self._make_inputs()
        self._outputs = connect_outputs(
            settings.outputs, self._names, self._types, self._node, bus, self._tree
        )
        self._requests = [self._serve(entry) for entry in settings.requests]
        parameters = DfpcParameters(settings.robot, settings.parameters, bus)
        self._parameters = ServerParameters(self._node, settings.robot, parameters, bus)
        self._use_sim_time: Any = None
        self._threads: list[threading.Thread] = []
        self._stop = threading.Event()
        self._node.watch_parameter("/use_sim_time", self._on_sim_time)
        self._clock = ClockTopic(bus.mission_clock, self._types, self._node) if settings.clock else None

    def run(self, stop: threading.Event) -> None:
        """Register with the master, and publish the status every second until ``stop`` is set."""
        with ExitStack() as stack:
            stack.callback(self._node.close)
            for link in self._inputs:
                stack.callback(link.close)
            self._node.start()
            thread = threading.Thread(
                target=self._parameters.retry, args=(stop,), name="parameters", daemon=True
            )
            self._threads.append(thread)
            thread.start()
            self._frames.start(stop)
            if self._clock is not None:
                self._clock.start(self._bus.loops, stop)
            self._stop = stop
            while True:
                key = keys.gateway_status(self._settings.robot, SERVICE)
                self._bus.publish_latched(key, self.status())
                if stop.wait(_STATUS_S):
                    return

    def problem(self) -> str:
        """Return the problem of a thread of the gateway or of its node, or an empty text."""
        is_running = not self._stop.is_set()
        ended = [thread.name for thread in self._threads if is_running and not thread.is_alive()]
        return f"the thread {ended[0]!r} of the gateway has ended" if ended else self._node.problem()

    def status(self) -> dict[str, Any]:
        """Return the message of the status key: the counters of each topic."""
        return {
            "node": self._node.name,
            "master": {
                "uri": self._node.master_uri,
                "registered": self._node.is_registered,
                "faults": self._node.master_faults,
                "last_fault": self._node.last_master_fault,
            },
            "use_sim_time": self._use_sim_time,
            **status_of(self._inputs, self._outputs, self._requests, missed=self._node.dropped),
            "frame_tree": self._tree.to_map(),
            "parameters": self._parameters.to_map(),
        }

    def _on_sim_time(self, value: Any) -> None:
        self._use_sim_time = value

    def _make_inputs(self) -> list[InputLink]:
        by_topic = links_by_topic(self._settings.inputs, self._names, self._types, self._bus, self._tree)
        links = [link for same in by_topic.values() for link in same]
        further: dict[str, list[tuple[InputLink, FurtherTopic]]] = {}
        for link in links:
            for item in link.further_topics:
                further.setdefault(item.topic, []).append((link, item))
        for topic, same in by_topic.items():
            self._subscribe(topic, same[0].entry.type, [(link, link.on_message) for link in same])
        for topic, items in further.items():
            receivers = [(link, item.receive) for link, item in items]
            self._subscribe(topic, items[0][1].type_name, receivers)
        return links

    def _subscribe(
        self, topic: str, type_name: str, receivers: list[tuple[InputLink, Callable[[bytes], None]]]
    ) -> None:
        def on_message(data: bytes) -> None:
            for _, receive in receivers:
                receive(data)

        def on_fault(reason: str, detail: str) -> None:
            for link, _ in receivers:
                link.drop(reason, detail)

        largest = max(link.entry.max_bytes for link, _ in receivers)
        self._node.subscribe(topic, type_name, on_message, on_fault, max_bytes=largest)

    def _serve(self, entry: RequestEntry) -> ProductRequests:
        service = ServiceType.register(self._types, entry.type, SERVICES[entry.type].definition)
        requests = ProductRequests(entry, service.response, self._names, self._types, self._client)
        self._node.serve(entry.name, service, requests.answer)
        return requests
