# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""States of devices of ROS: ``diagnostic_msgs/DiagnosticArray`` as an event."""

from __future__ import annotations

from typing import Any

import msgpack
import numpy as np

from cdff_common.errors import InputError
from cdff_common.types import Event, Time
from services.ros_messages.topics import Topic

#: Kind of the events, and largest body.
DIAGNOSTICS, MAX_BODY = "diagnostics", 65536


def event(message: Any, topic: Topic, stamp_ns: int) -> tuple[Event, str, None]:
    """Return the states as an event, whose body is a MessagePack map.

    Raises
    ------
    InputError
        If the body is larger than an event can hold.
    """
    states = [
        {
            "level": int(status.level),
            "name": status.name,
            "message": status.message,
            "hardware_id": status.hardware_id,
            "values": [[pair.key, pair.value] for pair in status.values],
        }
        for status in message.status
    ]
    body = msgpack.packb({"frame": message.header.frame_id, "status": states})
    if len(body) > MAX_BODY:
        raise InputError(f"{topic.name}: states of {len(body)} bytes, expected at most {MAX_BODY}")
    value = Event(
        time_stamp=Time.from_ns(stamp_ns),
        scope=topic.robot,
        kind=DIAGNOSTICS,
        body=np.frombuffer(body, np.uint8),
    )
    return value, topic.frame(message.header.frame_id), None
