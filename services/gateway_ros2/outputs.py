# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products on the bus that become topics of the robot."""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping
from typing import Any

from cdff_common.bus import Bus, Message, Qos
from cdff_common.clock import monotonic_s, wall_ns
from cdff_common.codecs import decode_payload
from cdff_common.errors import CdffError, InputError
from cdff_common.interfaces.product import Header, Status
from cdff_common.types import TransformWithCovariance
from services.gateway_ros2 import rmw_zenoh
from services.gateway_ros2.counters import RateLimit, TopicCounters
from services.gateway_ros2.settings import TF, OutputTopic
from services.ros_messages.encoders import encoder, transform_message
from services.ros_messages.encoding import Outgoing, Target
from services.ros_messages.message_types import RosTypes
from services.ros_messages.type_hashes import message_hash

logger = logging.getLogger(__name__)


class FrameTree:
    """Frames that the gateway publishes: each has one parent, and none is below itself."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._parents: dict[str, str] = {}

    def add(self, parent: str, child: str) -> None:
        """Add an edge; raises InputError if its child has another parent or is above its parent."""
        with self._lock:
            known = self._parents.get(child, parent)
            if known != parent:
                raise InputError(f"frame {child} below {parent}: it is already below {known}")
            above: str | None = parent
            while above is not None:
                if above == child:
                    raise InputError(f"frame {child} below {parent}: {parent} is below {child}, a loop")
                above = self._parents.get(above)
            self._parents[child] = parent


class Publishers:
    """Publishers of a node: each topic has a token, a number of its messages and an id.

    Parameters
    ----------
    bus : Bus
        Connection to the router of the robot.
    node : Node
    ros_types : RosTypes
    first_number : int
        Number of the first entity; each publisher has the next one.
    """

    def __init__(self, bus: Bus, node: rmw_zenoh.Node, ros_types: RosTypes, first_number: int) -> None:
        self._bus, self._node, self._ros_types = bus, node, ros_types
        self._next = first_number
        self._lock = threading.Lock()
        self._publishers: dict[tuple[str, str], tuple[str, bytes]] = {}
        self._seq: dict[tuple[str, str], int] = {}

    def declare(self, topic: str, type_name: str) -> None:
        """Declare a publisher with its token, by which tools find the topic, unless there is one."""
        with self._lock:
            if (topic, type_name) in self._publishers:
                return
            type_hash = message_hash(self._ros_types.store.fielddefs, type_name)
            token = self._node.entity_token(
                self._next, "MP", topic, type_name, type_hash, rmw_zenoh.QOS_DEFAULT
            )
            key = rmw_zenoh.data_key(self._node.domain, topic, type_name, type_hash)
            self._publishers[topic, type_name] = key, rmw_zenoh.gid_of(token)
            self._next += 1
        self._bus.declare_token(token)

    def publish(self, out: Outgoing) -> None:
        """Publish a message."""
        self.declare(out.topic, out.type_name)
        name = out.topic, out.type_name
        key, gid = self._publishers[name]
        with self._lock:
            self._seq[name] = seq = self._seq.get(name, 0) + 1
        self._bus.publish(
            key,
            bytes(self._ros_types.serialize(out.message, out.type_name)),
            encoding=rmw_zenoh.ENCODING,
            attachment=rmw_zenoh.Attachment(seq, wall_ns(), gid).to_bytes(),
            qos=Qos.STREAM,
        )


class OutputLink:
    """A product and the topic that it becomes.

    Parameters
    ----------
    entry : OutputTopic
    robot : str
    frames : mapping of str to str
        Frames of CDFF by their ``frame_id``.
    ros_types : RosTypes
    publishers : Publishers
    frame_tree : FrameTree
        Frames of all transforms that the gateway publishes.
    """

    def __init__(
        self,
        entry: OutputTopic,
        robot: str,
        frames: Mapping[str, str],
        ros_types: RosTypes,
        publishers: Publishers,
        frame_tree: FrameTree,
    ) -> None:
        self.entry, self.counters = entry, TopicCounters()
        self._robot, self._frames, self._ros_types = robot, frames, ros_types
        self._frame_ids = {frame: frame_id for frame_id, frame in frames.items()}
        self._publishers, self._rate = publishers, RateLimit(entry.max_hz)
        self._frame_tree = frame_tree
        self._cameras: dict[str, Any] = {}

    def on_message(self, message: Message) -> None:
        """Convert a product and publish it; one with a fault is counted and dropped."""
        start_s = monotonic_s()
        self.counters.receive(len(message.payload))
        if not self._rate.admits(start_s):
            self._drop("rate", f"more than {self.entry.max_hz:g} messages per second")
            return
        try:
            header = Header.from_attachment(message.attachment)
            if header.quality.status is Status.FAILED:
                self._drop("failed", f"its producer reports FAILED: {', '.join(header.quality.reasons)}")
                return
            for out in self._messages(decode_payload(message.payload, message.encoding), header):
                self._publishers.publish(out)
        except CdffError as error:
            self._drop("content", f"{type(error).__name__}: {error}")
            return
        self.counters.forward(monotonic_s() - start_s)

    def _messages(self, value: Any, header: Header) -> tuple[Outgoing, ...]:
        target = Target(
            self.entry.topic, self._robot, header.frame or "", self._frame_id, self._frames, self._cameras
        )
        if self.entry.type == TF:
            if not isinstance(value, TransformWithCovariance):
                raise InputError(f"a {type(value).__name__} as {TF}: expected a TransformWithCovariance")
            self._frame_tree.add(value.parent_frame, value.child_frame)
            transform = transform_message(value, target, self._ros_types, header.t1_ns)
            message = self._ros_types.make("tf2_msgs/TFMessage", transforms=[transform])
            return (Outgoing(self.entry.topic, TF, message),)
        encode = encoder(value.ASN1_NAME, self.entry.type)
        return tuple(encode(value, target, self._ros_types, header.t1_ns).messages)

    def _frame_id(self, frame: str) -> str:
        """Return the name of a frame in messages: that of the settings, or without the robot."""
        return self._frame_ids.get(frame) or frame.removeprefix(f"{self._robot}/")

    def _drop(self, reason: str, detail: str) -> None:
        if self.counters.drop(reason, detail):
            logger.warning("%s: dropped (%s): %s", self.entry.product, reason, detail)
