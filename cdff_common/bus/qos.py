# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Quality of service by purpose: one table from what a message is for to how Zenoh carries it.

Control blocks and jumps the queue; poses and clock are dropped rather than late; streams give way; products arrive.
"""

from __future__ import annotations

from enum import Enum
from typing import Any

import zenoh


class Qos(Enum):
    """What a message is for."""

    CONTROL = "control"
    POSE = "pose"
    STREAM = "stream"
    PRODUCT = "product"


_TABLE: dict[Qos, tuple[zenoh.Priority, zenoh.CongestionControl, bool]] = {
    Qos.CONTROL: (zenoh.Priority.INTERACTIVE_HIGH, zenoh.CongestionControl.BLOCK, True),
    Qos.POSE: (zenoh.Priority.DATA_HIGH, zenoh.CongestionControl.DROP, True),
    Qos.STREAM: (zenoh.Priority.DATA, zenoh.CongestionControl.DROP, False),
    Qos.PRODUCT: (zenoh.Priority.DATA_LOW, zenoh.CongestionControl.BLOCK, False),
}


def put_options(qos: Qos) -> dict[str, Any]:
    """Keyword arguments of ``Session.put`` for a purpose."""
    priority, congestion, express = _TABLE[qos]
    return {"priority": priority, "congestion_control": congestion, "express": express}
