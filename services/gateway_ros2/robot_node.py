# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The node of the gateway in the network of the robot: publishers, subscriptions and services with tokens."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cdff_common.bus import Bus, Message, Qos, Subscription
from cdff_common.bus.foreign import CachingPublisher, ForeignCall
from cdff_common.clock import wall_ns
from cdff_common.errors import CdffError, CodecError
from services.gateway_ros2 import rmw_zenoh
from services.gateway_ros2.rmw_zenoh import QOS_DEFAULT, QOS_LATCHED, QOS_SENSOR_DATA, Quality
from services.gateways.inputs import DECODER_ERRORS
from services.ros_messages.encoding import Outgoing
from services.ros_messages.message_types import RosTypes
from services.ros_messages.service_types import ServiceType
from services.ros_messages.type_hashes import message_hash

logger = logging.getLogger(__name__)

#: Handler of a service. It is called with a request and a function that sends the response. The handler may
#: call this function itself, or another thread calls it later.
ServiceHandler = Callable[[Any, Callable[[Any], None]], None]

_QUALITIES = {"default": QOS_DEFAULT, "sensor_data": QOS_SENSOR_DATA, "latched": QOS_LATCHED}


@dataclass(slots=True)
class _Publisher:
    """A declared publisher: its key, its id and the number of its last message."""

    key: str
    gid: bytes
    cache: CachingPublisher | None
    seq: int = 0


class RobotNode:
    """A node of ROS 2 on ``rmw_zenoh``.

    Parameters
    ----------
    bus : Bus
        Connection to the router of the robot.
    domain : int
    name : str
    types : RosTypes
    """

    def __init__(self, bus: Bus, domain: int, name: str, types: RosTypes) -> None:
        self.bus, self.types = bus, types
        self.node = rmw_zenoh.Node(domain, bus.zid, name)
        self._lock = threading.Lock()
        self._entities = 0
        self._gids: set[bytes] = set()
        self._publishers: dict[tuple[str, str], _Publisher] = {}
        bus.declare_token(self.node.token)

    def is_own(self, attachment: bytes) -> bool:
        """Return True for the attachment of a message of this node, which would circulate."""
        return attachment[-rmw_zenoh.GID_BYTES :] in self._gids

    def hash_of(self, type_name: str) -> str:
        """Return the hash of a message type."""
        return message_hash(self.types.store.fielddefs, type_name)

    def declare_publisher(self, topic: str, type_name: str, *, latched: bool, type_hash: str = "") -> None:
        """Declare a publisher with its token, by which tools find the topic, unless there is one."""
        with self._lock:
            if (topic, type_name) in self._publishers:
                return
            type_hash = type_hash or self.hash_of(type_name)
            quality = QOS_LATCHED if latched else QOS_DEFAULT
            token = self._token("MP", topic, type_name, type_hash, quality)
            key = rmw_zenoh.data_key(self.node.domain, topic, type_name, type_hash)
            cache = self.bus.foreign.publisher(key, depth=quality.depth) if latched else None
            self._publishers[topic, type_name] = _Publisher(key, rmw_zenoh.gid_of(token), cache)
            self._gids.add(rmw_zenoh.gid_of(token))
        self.bus.declare_token(token)

    def publish(self, out: Outgoing, *, latched: bool) -> None:
        """Publish a message."""
        self.declare_publisher(out.topic, out.type_name, latched=latched)
        data = bytes(self.types.serialize(out.message, out.type_name))
        self.publish_bytes(out.topic, out.type_name, data)

    def publish_bytes(self, topic: str, type_name: str, data: bytes) -> None:
        """Publish an encoded message of a declared publisher."""
        publisher = self._publishers[topic, type_name]
        with self._lock:
            publisher.seq += 1
            attachment = rmw_zenoh.Attachment(publisher.seq, wall_ns(), publisher.gid).to_bytes()
        if publisher.cache is not None:
            publisher.cache.publish(data, encoding=rmw_zenoh.ENCODING, attachment=attachment)
            return
        self.bus.publish(
            publisher.key, data, encoding=rmw_zenoh.ENCODING, attachment=attachment, qos=Qos.STREAM
        )

    def subscribe(
        self, topic: str, type_name: str, quality: str, callback: Callable[[Message], None], depth: int
    ) -> Subscription:
        """Subscribe to a topic with any version of its type; ``quality`` is that of the settings."""
        with self._lock:
            token = self._token("MS", topic, type_name, self.hash_of(type_name), _QUALITIES[quality])
        self.bus.declare_token(token)
        key = rmw_zenoh.data_key(self.node.domain, topic, type_name, "*")
        if quality == "latched":
            return self.bus.foreign.subscribe_cached(key, callback, depth=depth)
        return self.bus.subscribe(key, callback, depth=depth)

    def serve(self, name: str, service: ServiceType, handler: ServiceHandler, *, workers: int = 2) -> None:
        """Answer a service.

        Parameters
        ----------
        name : str
        service : ServiceType
        handler : callable
            Called with a request and the function that sends the response, now or later.
        workers : int
            Threads of the handler.
        """

        def on_call(call: ForeignCall) -> None:
            try:
                asked = rmw_zenoh.Attachment.from_bytes(call.attachment)
                request = self.types.deserialize(call.payload, service.request)
            except (CodecError, *DECODER_ERRORS) as error:
                logger.warning(
                    "%s: refused: %d bytes of %s: %s", name, len(call.payload), service.name, error
                )
                call.refuse(f"{len(call.payload)} bytes of {service.name}: {error}")
                return

            def respond(response: Any) -> None:
                try:
                    data = bytes(self.types.serialize(response, service.response))
                except (AttributeError, *DECODER_ERRORS) as error:
                    logger.exception("%s: a response cannot be encoded", name)
                    call.refuse(f"the response of {service.name} cannot be encoded: {error}")
                    return
                attachment = rmw_zenoh.Attachment(asked.seq, wall_ns(), asked.gid).to_bytes()
                call.reply(data, encoding=rmw_zenoh.ENCODING, attachment=attachment)

            try:
                handler(request, respond)
            except CdffError as error:
                call.refuse(str(error))

        with self._lock:
            token = self._token("SS", name, service.name, service.type_hash, QOS_DEFAULT)
        key = rmw_zenoh.data_key(self.node.domain, name, service.name, service.type_hash)
        self.bus.foreign.serve(key, on_call, workers=workers)
        self.bus.declare_token(token)

    def _token(
        self, kind: rmw_zenoh.Kind, topic: str, type_name: str, type_hash: str, quality: Quality
    ) -> str:
        self._entities += 1
        return self.node.entity_token(self._entities, kind, topic, type_name, type_hash, quality)
