# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Robot with Cyclone DDS: it sends and receives ``/tf`` with types of its own, for test_gateway_dds.py.

python dds_tree_peer.py SECONDS

``CYCLONEDDS_URI`` and ``ROS_DOMAIN_ID`` state the domain. It publishes the pose of a mast, and prints the
first transform that it receives as JSON, at the latest after SECONDS.
"""

import json
import os
import sys
import time
from dataclasses import dataclass

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


def mast(child="mast"):
    """Return the pose of a frame in the base."""
    seconds, nanoseconds = divmod(time.time_ns(), 10**9)
    pose = Transform(Vector3(0.5, 0.0, 1.25), Quaternion(0.0, 0.0, 0.0, 1.0))
    return TransformStamped(Header(Time(seconds, nanoseconds), "base_link"), child, pose)


def main():
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    topic = Topic(participant, "rt/tf", TFMessage)
    reliable = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(100))
    local = Qos(Policy.IgnoreLocal.Participant)
    reader = DataReader(participant, topic, qos=reliable + local)
    writer = DataWriter(participant, topic, qos=reliable)
    end_s, rounds, received = time.monotonic() + float(sys.argv[1]), 0, []
    while time.monotonic() < end_s and not (received and rounds >= 8):
        rounds += len(writer.get_matched_subscriptions()) > 0
        writer.write(TFMessage([mast()]))
        received += [edge for message in reader.take(10) for edge in message.transforms]
        time.sleep(0.25)
    edge = received[0] if received else None
    result = edge and {
        "frames": [edge.header.frame_id, edge.child_frame_id],
        "stamp_s": edge.header.stamp.sec,
        "position": [
            edge.transform.translation.x,
            edge.transform.translation.y,
            edge.transform.translation.z,
        ],
    }
    print(json.dumps(result), flush=True)


if __name__ == "__main__":
    main()
