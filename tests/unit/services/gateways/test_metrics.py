# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Counters of gateways among the metrics of the DPM."""

from __future__ import annotations

from typing import Any

from services.dpm.http.metrics import gateway_lines
from services.gateways.counters import TopicCounters
from services.gateways.frames import FrameNames, FrameTree
from services.gateways.outputs import OutputLink, StaticTransforms
from services.gateways.settings import OutputTopic
from services.gateways.status import status_of
from services.ros_messages.message_types import RosTypes


def test_each_topic_of_a_gateway_has_its_counters_and_latency() -> None:
    imu, pose = TopicCounters(), TopicCounters()
    for _ in range(3):
        imu.receive(316)
    imu.forward(0.002)
    imu.age(-0.25)
    imu.drop("rate", "too many")
    imu.drop("decoding", "316 bytes")
    status = {
        "inputs": {"/imu": {"type": "sensor_msgs/msg/Imu", **imu.to_map()}},
        "outputs": [{"topic": "/pose", "type": "nav_msgs/msg/Odometry", **pose.to_map()}],
    }
    lines = gateway_lines({("mana", "gateway_ros2"): status})
    names = 'robot="mana",gateway="gateway_ros2",direction="in",topic="/imu",type="sensor_msgs/msg/Imu"'
    assert f"cdff_gateway_received_total{{{names}}} 3" in lines
    assert f"cdff_gateway_forwarded_total{{{names}}} 1" in lines
    assert f'cdff_gateway_dropped_total{{{names},reason="rate"}} 1' in lines
    assert f"cdff_gateway_latency_seconds{{{names}}} 0.002000" in lines
    assert f"cdff_gateway_least_age_seconds{{{names}}} -0.250000" in lines
    assert any('direction="out",topic="/pose"' in line for line in lines)


def test_a_gateway_without_topics_has_no_lines() -> None:
    status = {"in_contact": True, "waiting": {"products": 0}, "problem": ""}  # of the gateway to CCSDS
    assert gateway_lines({("mana", "gateway_ccsds"): status}) == []


def test_messages_that_slow_subscribers_missed_are_counted_once_for_each_topic() -> None:
    entries = [
        OutputTopic(product="position_manager/pose", topic=topic) for topic in ("/pose", "/pose", "/other")
    ]
    publisher: Any = None
    names, types = FrameNames("mana"), RosTypes(1)
    outputs = [
        OutputLink(entry, names, types, publisher, FrameTree(), StaticTransforms()) for entry in entries
    ]
    counts = {"/pose": 7, "/other": 0}
    status = status_of([], outputs, [], missed=lambda topic, _: counts[topic])
    assert [output["dropped"] for output in status["outputs"]] == [{"slow_subscriber": 7}, {}, {}]


def test_without_gateways_there_are_no_lines() -> None:
    assert gateway_lines({}) == []
