# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The participant of the gateway in the DDS domain of the robot: topics in both directions."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import DDSException, Listener, ReadCondition, SampleState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from cdff_common.errors import UnavailableError
from services.gateway_dds.raw_types import RawTypes
from services.gateway_dds.settings import DdsSettings
from services.gateway_ros2.rmw_zenoh import dds_type
from services.ros_messages.encoding import Outgoing
from services.ros_messages.message_types import RosTypes

logger = logging.getLogger(__name__)

#: First bytes of messages in plain CDR, of either byte order.
_PLAIN_CDR = (b"\x00\x00", b"\x00\x01")
#: Interval at which the thread of the readers looks for the end, seconds.
_WAIT_S = 0.2
#: Messages that are read at once.
_BATCH = 16
#: Policies of quality of service by their number in the DDS standard.
_POLICIES = {
    2: "durability",
    4: "deadline",
    5: "latency budget",
    6: "ownership",
    8: "liveliness",
    11: "reliability",
    12: "destination order",
    23: "data representation",
    24: "type consistency",
}
Callback = Callable[[bytes], None]


def quality_of_service(quality: str, depth: int) -> Qos:
    """Return the policies of a quality of the settings: sensor_data, default or latched."""
    policies = [
        Policy.Reliability.BestEffort
        if quality == "sensor_data"
        else Policy.Reliability.Reliable(duration(milliseconds=100)),
        Policy.Durability.TransientLocal if quality == "latched" else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
    ]
    return Qos(*policies)


class RobotNode:
    """A participant with readers and writers of topics.

    Parameters
    ----------
    settings : DdsSettings
    types : RosTypes

    Attributes
    ----------
    conflicts : dict of str to str
        Topics with publishers or subscribers of the robot of another type or an incompatible quality of
        service, with the reason. No message passes between these.

    Raises
    ------
    UnavailableError
        If the interface does not exist, or the domain has no place for a participant.
    """

    def __init__(self, settings: DdsSettings, types: RosTypes) -> None:
        self.types = types
        self.conflicts: dict[str, str] = {}
        self.not_plain: dict[str, int] = {}
        try:
            self._domain = Domain(settings.domain, settings.configuration)
            self._participant = DomainParticipant(settings.domain)
        except DDSException as error:
            raise UnavailableError(
                f"domain {settings.domain} on interface {settings.interface!r}: {error}; expected an "
                f"interface of this machine, and fewer than {settings.participants} participants"
            ) from error
        self._raw = RawTypes(types)
        self._topics: dict[str, Topic[Any]] = {}
        self._writers: dict[tuple[str, str], DataWriter[Any]] = {}
        self._readers: list[tuple[str, DataReader[Any], Callback]] = []
        self._endpoints = [
            BuiltinDataReader(self._participant, topic)
            for topic in (BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription)
        ]
        self._names: dict[str, tuple[str, str]] = {}
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._waits = WaitSet(self._participant)
        self._thread = threading.Thread(target=self._read, name="dds readers", daemon=True)
        self._fault = ""

    def start(self) -> None:
        """Start to read; all subscriptions are made before."""
        self._thread.start()

    def close(self) -> None:
        """End reading."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(5 * _WAIT_S)

    def problem(self) -> str:
        """Return why no message is read, for the health check; empty without a problem."""
        if self._fault:
            return f"the thread of the DDS readers has ended: {self._fault}"
        was_started = self._thread.ident is not None
        if was_started and not self._thread.is_alive() and not self._stop.is_set():
            return "the thread of the DDS readers has ended"
        return ""

    def declare_publisher(self, topic: str, type_name: str, *, latched: bool) -> None:
        """Declare a topic before its first message."""
        with self._lock:
            if (topic, type_name) in self._writers:
                return
            qos = quality_of_service("latched" if latched else "default", 1 if latched else 10)
            listener = Listener()
            listener.set_on_offered_incompatible_qos(self._on_conflict(topic, "a subscriber"))
            writer = DataWriter(self._participant, self._topic(topic, type_name), qos=qos, listener=listener)
            self._writers[topic, type_name] = writer

    def publish(self, out: Outgoing, *, latched: bool) -> None:
        """Publish a message."""
        self.declare_publisher(out.topic, out.type_name, latched=latched)
        self.publish_bytes(out.topic, out.type_name, bytes(self.types.serialize(out.message, out.type_name)))

    def publish_bytes(self, topic: str, type_name: str, data: bytes) -> None:
        """Publish an encoded message of a declared publisher."""
        self._writers[topic, type_name].write(self._raw.of(type_name)(data))

    def subscribers(self, topic: str, type_name: str) -> int:
        """Return the number of subscribers of a declared publisher."""
        return len(self._writers[topic, type_name].get_matched_subscriptions())

    def subscribe(self, topic: str, type_name: str, quality: str, callback: Callback, depth: int) -> None:
        """Subscribe to a topic; ``callback`` takes messages in CDR. Own messages are not received."""
        listener = Listener()
        listener.set_on_requested_incompatible_qos(self._on_conflict(topic, "a publisher"))
        qos = quality_of_service(quality, depth) + Qos(Policy.IgnoreLocal.Participant)
        reader = DataReader(self._participant, self._topic(topic, type_name), qos=qos, listener=listener)
        condition = ReadCondition(reader, SampleState.NotRead)
        self._waits.attach(condition)
        self._readers.append((topic, reader, callback))

    def check_types(self) -> None:
        """Compare the types of the robot's publishers and subscribers with those of the settings."""
        for builtin, who in zip(self._endpoints, ("a publisher", "a subscriber"), strict=True):
            for endpoint in builtin.take(256):
                known = self._names.get(getattr(endpoint, "topic_name", ""))
                if known is None or endpoint.type_name == known[1]:
                    continue
                self._report(known[0], f"{who} has the type {endpoint.type_name}, expected {known[1]}")

    def _topic(self, topic: str, type_name: str) -> Topic[Any]:
        """Return the DDS topic of a topic of ROS 2: its name has the prefix ``rt``."""
        name = f"rt/{topic.strip('/')}"
        if name not in self._topics:
            self._topics[name] = Topic(self._participant, name, self._raw.of(type_name))
            self._names[name] = (topic, dds_type(type_name))
        return self._topics[name]

    def _on_conflict(self, topic: str, who: str) -> Callable[[Any, Any], None]:
        def on_conflict(_: Any, status: Any) -> None:
            policy = _POLICIES.get(status.last_policy_id, f"policy {status.last_policy_id}")
            if topic not in self.conflicts:  # another type is named by ``check_types``
                self._report(topic, f"{who} has another {policy}")

        return on_conflict

    def _report(self, topic: str, reason: str) -> None:
        if self.conflicts.get(topic) != reason:
            self.conflicts[topic] = reason
            logger.warning("%s: %s; no message passes between them", topic, reason)

    def _read(self) -> None:
        """Pass messages to the callbacks until the end."""
        try:
            while not self._stop.is_set():
                self._waits.wait(duration(seconds=_WAIT_S))
                for topic, reader, callback in self._readers:
                    for sample in reader.take(_BATCH):
                        data = getattr(sample, "data", None)
                        if data is None:  # the end of an instance, without a message
                            continue
                        if data[:2] not in _PLAIN_CDR:
                            self.not_plain[topic] = self.not_plain.get(topic, 0) + 1
                            continue
                        callback(data)
        except DDSException as error:
            self._fault = str(error)
            logger.exception("the thread of the DDS readers ends")
