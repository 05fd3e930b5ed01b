# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Requests of the robot, which a program of its ROS 2 (deploy/ros/request_relay.py) relays on two topics.

Implementations of DDS correlate the answers of services in different ways, so that the service itself is that
of the robot's ROS 2. A message on the topics is an identifier of 16 bytes, the length of the name of the
service (16 bits, little-endian), the name, and the request or the response in CDR.
"""

from __future__ import annotations

import logging
import struct
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from cdff_common.client import Client
from cdff_common.errors import CdffError, InputError
from services.gateway_dds.robot_node import RobotNode
from services.gateways.frames import FrameNames
from services.gateways.inputs import DECODER_ERRORS
from services.gateways.request_types import SERVICES
from services.gateways.requests import ProductRequests
from services.gateways.settings import RequestEntry
from services.ros_messages.encoding import Outgoing
from services.ros_messages.message_types import RosTypes
from services.ros_messages.service_types import ServiceType

logger = logging.getLogger(__name__)

BYTES = "std_msgs/msg/UInt8MultiArray"
_ID_BYTES, _NAME_LENGTH = 16, struct.Struct("<H")
_HEADER_BYTES = _ID_BYTES + _NAME_LENGTH.size
#: Requests that run, and those that wait; with more they are dropped.
_WORKERS, _MAX_WAITING = 4, 16
#: Largest request, bytes.
_MAX_BYTES = 1 << 16


def split_message(data: bytes) -> tuple[bytes, str, bytes]:
    """Return identifier, name of the service and content of a relayed message; raises InputError."""
    if not _HEADER_BYTES <= len(data) <= _MAX_BYTES:
        raise InputError(f"request of {len(data)} bytes: expected {_HEADER_BYTES} to {_MAX_BYTES}")
    (length,) = _NAME_LENGTH.unpack_from(data, _ID_BYTES)
    name = data[_HEADER_BYTES : _HEADER_BYTES + length]
    if len(name) != length:
        raise InputError(f"name of {length} bytes in a request of {len(data)} bytes")
    return data[:_ID_BYTES], name.decode("utf-8", "replace"), data[_HEADER_BYTES + length :]


class RelayedRequests:
    """Services of the gateway, whose requests arrive on a topic.

    Parameters
    ----------
    entries : sequence of RequestEntry
    node_name : str
        Name of the gateway's node, the first part of the names of the topics.
    names : FrameNames
    types : RosTypes
    node : RobotNode
    client : Client
    """

    def __init__(
        self,
        entries: Sequence[RequestEntry],
        node_name: str,
        names: FrameNames,
        types: RosTypes,
        node: RobotNode,
        client: Client,
    ) -> None:
        self._types, self._node = types, node
        self._services: dict[str, tuple[ServiceType, ProductRequests]] = {}
        for entry in entries:
            service = ServiceType.register(types, entry.type, SERVICES[entry.type].definition)
            requests = ProductRequests(entry, service.response, names, types, client)
            self._services[entry.name] = service, requests
        self.faults, self.last_fault = 0, ""
        self._waiting, self._lock = 0, threading.Lock()
        self._pool = ThreadPoolExecutor(_WORKERS, thread_name_prefix="relayed requests")
        self._topic = f"/{node_name}/responses"
        if entries:
            node.declare_publisher(self._topic, BYTES, latched=False)
            node.subscribe(f"/{node_name}/requests", BYTES, "default", self.on_message, _MAX_WAITING)

    @property
    def requests(self) -> list[ProductRequests]:
        """Requests with their counters."""
        return [requests for _, requests in self._services.values()]

    def close(self) -> None:
        """Drop the requests that wait."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def on_message(self, data: bytes) -> None:
        """Answer a relayed request; a malformed one, or one of too many, is counted and dropped."""
        try:
            message = self._types.deserialize(data, BYTES)
            identifier, name, content = split_message(bytes(np.asarray(message.data, np.uint8)))
            if name not in self._services:
                raise InputError(f"service {name[:80]!r}: expected one of {', '.join(self._services)}")
            with self._lock:
                if self._waiting >= _WORKERS + _MAX_WAITING:
                    raise InputError(f"{self._waiting} requests wait")
                self._waiting += 1
        except (CdffError, *DECODER_ERRORS) as error:
            self._drop(f"{type(error).__name__}: {error}")
            return
        self._pool.submit(self._answer, identifier, name, content)

    def _answer(self, identifier: bytes, name: str, content: bytes) -> None:
        service, requests = self._services[name]
        try:
            request = self._types.deserialize(content, service.request)
            response = requests.answer(request)
            answer = bytes(self._types.serialize(response, service.response))
            head = identifier + _NAME_LENGTH.pack(len(name.encode())) + name.encode()
            self._node.publish(Outgoing(self._topic, BYTES, self._message(head + answer)), latched=False)
        except (CdffError, *DECODER_ERRORS) as error:
            self._drop(f"{name}: {type(error).__name__}: {error}")
        except Exception:
            logger.exception("%s failed", name)
        finally:
            with self._lock:
                self._waiting -= 1

    def _message(self, data: bytes) -> Any:
        layout = self._types.make("std_msgs/MultiArrayLayout", dim=[], data_offset=0)
        return self._types.make("std_msgs/UInt8MultiArray", layout=layout, data=np.frombuffer(data, np.uint8))

    def _drop(self, detail: str) -> None:
        self.faults, self.last_fault = self.faults + 1, detail[:300]
        if self.faults == 1:
            logger.warning("a relayed request is dropped: %s", detail)
