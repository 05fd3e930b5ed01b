# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products on the bus that become topics of the robot."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, Protocol

from cdff_common.bus import Bus, keys
from cdff_common.errors import InputError
from cdff_common.interfaces.product import Header
from cdff_common.types import TransformWithCovariance
from services.gateways.frames import FrameNames, FrameTree
from services.gateways.product_link import ProductLink
from services.gateways.settings import TF, OutputTopic
from services.ros_messages.conversions import IMAGES
from services.ros_messages.encoders import encoder, transform_message
from services.ros_messages.encoding import Outgoing, Target
from services.ros_messages.fixes import FIX, LocalFrame
from services.ros_messages.message_types import RosTypes


class Publisher(Protocol):
    """A node of the robot's network that publishes messages."""

    def declare_publisher(self, topic: str, type_name: str, *, latched: bool) -> None:
        """Declare a topic before its first message."""

    def publish(self, out: Outgoing, *, latched: bool) -> None:
        """Publish a message; a latched one is sent to subscribers that join later, too."""


class StaticTransforms:
    """Latched transforms of a topic: its last message, which late subscribers receive, holds all of them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._by_child: dict[tuple[str, str], Any] = {}

    def merged(self, topic: str, transform: Any) -> list[Any]:
        """Add a transform, and return all of the topic."""
        with self._lock:
            self._by_child[topic, transform.child_frame_id] = transform
            return [t for (name, _), t in self._by_child.items() if name == topic]


class OutputLink(ProductLink):
    """A product and the topic that it becomes.

    Parameters
    ----------
    entry : OutputTopic
    names : FrameNames
    ros_types : RosTypes
    publisher : Publisher
    tree : FrameTree
        Frames of all transforms of the robot, the gateway and the DPM.
    static : StaticTransforms
        Latched transforms of all its topics.
    """

    def __init__(
        self,
        entry: OutputTopic,
        names: FrameNames,
        ros_types: RosTypes,
        publisher: Publisher,
        tree: FrameTree,
        static: StaticTransforms,
    ) -> None:
        super().__init__(entry)
        self.entry = entry
        self._names, self._ros_types, self._publisher = names, ros_types, publisher
        self._tree, self._static = tree, static
        self._cameras: dict[str, Any] = {}

    def send(self, value: Any, header: Header) -> None:
        """Publish a value on the topic."""
        for out in self._messages(value, header):
            self._publisher.publish(out, latched=self.entry.is_latched)

    def _messages(self, value: Any, header: Header) -> tuple[Outgoing, ...]:
        target = Target(
            self.entry.topic,
            self._names.robot,
            header.frame or "",
            self._names.of_robot,
            self._names.frames,
            self._cameras,
            self._local_frame(value),
        )
        if self.entry.type == TF:
            return (self._frame_tree(value, target, header.t1_ns),)
        encode = encoder(value.ASN1_NAME, self.entry.type)
        return tuple(encode(value, target, self._ros_types, header.t1_ns).messages)

    def _local_frame(self, value: Any) -> LocalFrame | None:
        """Return the located frame of a position; raises InputError if it has no location."""
        if self.entry.type != FIX:
            return None
        frame = value.parent_frame if isinstance(value, TransformWithCovariance) else ""
        local = self._names.local_frame(frame)
        if local is None:
            raise InputError(f"frame {frame!r} as {FIX}: expected an entry under origins in the settings")
        return local

    def _frame_tree(self, value: Any, target: Target, stamp_ns: int) -> Outgoing:
        if not isinstance(value, TransformWithCovariance):
            raise InputError(f"a {type(value).__name__} as {TF}: expected a TransformWithCovariance")
        is_static, value = self.entry.is_latched, self._tree.of_carrier(value)
        self._tree.add(value.parent_frame, value.child_frame, with_dpm=True, is_static=is_static)
        transform = transform_message(value, target, self._ros_types, stamp_ns)
        transforms = self._static.merged(self.entry.topic, transform) if is_static else [transform]
        message = self._ros_types.make("tf2_msgs/TFMessage", transforms=transforms)
        return Outgoing(self.entry.topic, TF, message)


def connect_outputs(
    entries: Sequence[OutputTopic],
    names: FrameNames,
    ros_types: RosTypes,
    publisher: Publisher,
    bus: Bus,
    tree: FrameTree,
) -> list[OutputLink]:
    """Declare the topics of outputs, and subscribe to the products that become their messages."""
    static = StaticTransforms()
    links = [OutputLink(entry, names, ros_types, publisher, tree, static) for entry in entries]
    for link in links:
        entry = link.entry
        # Images have topics below the listed one, which are declared with the first image.
        if entry.type not in IMAGES:
            publisher.declare_publisher(entry.topic, entry.type, latched=entry.is_latched)
        dfpc, port = entry.product.split("/")
        bus.subscribe(keys.product(names.robot, dfpc, port), link.on_message)
    return links
