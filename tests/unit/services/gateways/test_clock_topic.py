# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mission time as the clock of a robot."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from cdff_common.loops import Loops
from cdff_common.mission_clock import MissionClock
from services.gateways.clock_topic import ClockTopic
from services.ros_messages.encoding import Outgoing
from services.ros_messages.message_types import RosTypes
from tests.integration.conftest import wait_until

_NS = 1_600_000_000_012_345_000


class Published:
    """Messages and topics of a node."""

    def __init__(self) -> None:
        self.declared: list[tuple[str, str, bool]] = []
        self.messages: list[Outgoing] = []

    def declare_publisher(self, topic: str, type_name: str, *, latched: bool) -> None:
        self.declared.append((topic, type_name, latched))

    def publish(self, out: Outgoing, *, latched: bool) -> None:
        assert not latched
        self.messages.append(out)


@pytest.mark.parametrize("version", [1, 2])
def test_mission_time_is_published_while_the_gateway_runs(version: int) -> None:
    clock, node, types = MissionClock(), Published(), RosTypes(version)
    clock.on_tick(_NS, 0.0)  # a paused simulation
    topic = ClockTopic(clock, types, node)
    assert node.declared == [("/clock", "rosgraph_msgs/msg/Clock", False)]
    stop, loops = threading.Event(), Loops()
    topic.start(loops, stop)
    wait_until(lambda: len(node.messages) >= 2, 10.0, "two messages")
    assert loops.problem() == ""
    stop.set()
    message: Any = types.deserialize(
        bytes(types.serialize(node.messages[-1].message, "rosgraph_msgs/msg/Clock")),
        "rosgraph_msgs/msg/Clock",
    )
    assert message.clock.sec * 10**9 + message.clock.nanosec == _NS
