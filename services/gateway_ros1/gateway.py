# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to ROS 1: a node of the robot, the bus, and what passes between them."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from cdff_common.errors import UnavailableError
from services.gateway_ros1.node import Ros1Node
from services.gateway_ros1.parameters import ServerParameters
from services.gateway_ros1.settings import Ros1Settings
from services.gateways.dfpc_parameters import DfpcParameters
from services.gateways.frames import FrameNames
from services.gateways.inputs import InputLink, links_by_topic
from services.gateways.outputs import connect_outputs
from services.gateways.request_types import SERVICES
from services.gateways.requests import ProductRequests
from services.gateways.settings import RequestEntry
from services.gateways.status import status_of
from services.ros_messages.conversions import CAMERA_INFO
from services.ros_messages.encoding import Outgoing
from services.ros_messages.message_types import RosTypes
from services.ros_messages.service_types import ServiceType

logger = logging.getLogger(__name__)

SERVICE = "gateway_ros1"
_STATUS_S, _CLOCK_S = 1.0, 0.05
_CLOCK = "rosgraph_msgs/msg/Clock"
_NS_PER_S = 1_000_000_000


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
        self._names = FrameNames(settings.robot, settings.frames)
        self._inputs = self._make_inputs()
        self._outputs = connect_outputs(settings.outputs, self._names, self._types, self._node, bus)
        self._requests = [self._serve(entry) for entry in settings.requests]
        parameters = DfpcParameters(settings.robot, settings.parameters, bus)
        self._parameters = ServerParameters(self._node, settings.robot, parameters, bus)
        self._use_sim_time: Any = None
        self._threads: list[threading.Thread] = []
        self._stop = threading.Event()
        self._node.watch_parameter("/use_sim_time", self._on_sim_time)
        if settings.clock:
            self._node.declare_publisher("/clock", _CLOCK, latched=False)

    def run(self, stop: threading.Event) -> None:
        """Register with the master, and publish the status every second until ``stop`` is set."""
        with ExitStack() as stack:
            stack.callback(self._node.close)
            for link in self._inputs:
                stack.callback(link.close)
            self._node.start()
            works = {"parameters": self._parameters.retry}
            if self._settings.clock:
                works["clock"] = self._publish_clock
            for name, work in works.items():
                thread = threading.Thread(target=work, args=(stop,), name=name, daemon=True)
                self._threads.append(thread)
                thread.start()
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
            "parameters": self._parameters.to_map(),
        }

    def _on_sim_time(self, value: Any) -> None:
        self._use_sim_time = value

    def _make_inputs(self) -> list[InputLink]:
        by_topic = links_by_topic(self._settings.inputs, self._names, self._types, self._bus)
        links = [link for same in by_topic.values() for link in same]
        by_calibration: dict[str, list[InputLink]] = {}
        for link in links:
            if link.entry.camera_info is not None:
                by_calibration.setdefault(link.entry.camera_info, []).append(link)
        for topic, same in by_topic.items():
            self._subscribe(topic, same[0].entry.type, same, InputLink.on_message)
        for topic, same in by_calibration.items():
            self._subscribe(topic, CAMERA_INFO, same, InputLink.on_camera_info)
        return links

    def _subscribe(
        self, topic: str, type_name: str, links: list[InputLink], receive: Callable[[InputLink, bytes], None]
    ) -> None:
        def on_message(data: bytes) -> None:
            for link in links:
                receive(link, data)

        def on_fault(reason: str, detail: str) -> None:
            for link in links:
                link.drop(reason, detail)

        largest = max(link.entry.max_bytes for link in links)
        self._node.subscribe(topic, type_name, on_message, on_fault, max_bytes=largest)

    def _serve(self, entry: RequestEntry) -> ProductRequests:
        service = ServiceType.register(self._types, entry.type, SERVICES[entry.type].definition)
        requests = ProductRequests(entry, service.response, self._names, self._types, self._client)
        self._node.serve(entry.name, service, requests.answer)
        return requests

    def _publish_clock(self, stop: threading.Event) -> None:
        clock = self._bus.mission_clock
        while not stop.wait(_CLOCK_S):
            with suppress(UnavailableError):
                now_ns = clock.now_ns()
                time = self._types.make(
                    "builtin_interfaces/Time", sec=now_ns // _NS_PER_S, nanosec=now_ns % _NS_PER_S
                )
                message = self._types.make("rosgraph_msgs/Clock", clock=time)
                self._node.publish(Outgoing("/clock", _CLOCK, message), latched=False)
