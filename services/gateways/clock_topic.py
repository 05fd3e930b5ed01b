# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The mission clock as the topic ``/clock`` of the robot."""

from __future__ import annotations

import threading
from contextlib import suppress

from cdff_common.errors import UnavailableError
from cdff_common.loops import Loops
from cdff_common.mission_clock import MissionClock
from services.gateways.outputs import Publisher
from services.ros_messages.encoding import Outgoing
from services.ros_messages.message_types import RosTypes

_TOPIC, _TYPE = "/clock", "rosgraph_msgs/msg/Clock"
#: Interval, and time after which the thread counts as hung, seconds.
_PERIOD_S, _BUSY_S = 0.05, 30.0
_NS_PER_S = 1_000_000_000


class ClockTopic:
    """Publisher of the mission clock at 20 Hz.

    Parameters
    ----------
    clock : MissionClock
    types : RosTypes
    publisher : Publisher
    """

    def __init__(self, clock: MissionClock, types: RosTypes, publisher: Publisher) -> None:
        self._clock, self._types, self._publisher = clock, types, publisher
        publisher.declare_publisher(_TOPIC, _TYPE, latched=False)

    def start(self, loops: Loops, stop: threading.Event) -> None:
        """Publish in a thread, which ``loops`` checks, until ``stop`` is set."""
        loop = loops.add("clock", _BUSY_S)
        threading.Thread(
            target=loop.run,
            args=(lambda: None if stop.wait(_PERIOD_S) else True, lambda _: self.publish()),
            name=loop.name,
            daemon=True,
        ).start()

    def publish(self) -> None:
        """Publish mission time once, unless there is none."""
        with suppress(UnavailableError):
            now_ns = self._clock.now_ns()
            time = self._types.make(
                "builtin_interfaces/Time", sec=now_ns // _NS_PER_S, nanosec=now_ns % _NS_PER_S
            )
            message = self._types.make("rosgraph_msgs/Clock", clock=time)
            self._publisher.publish(Outgoing(_TOPIC, _TYPE, message), latched=False)
