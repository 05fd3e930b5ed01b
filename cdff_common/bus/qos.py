# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Quality of service: one table from the purpose of a message to its Zenoh options.

Control messages block and have priority; poses and clock ticks are dropped rather than delayed; streams have
low priority; products are delivered reliably.
"""

from __future__ import annotations

from enum import Enum

from zenoh import CongestionControl, Priority


class Qos(Enum):
    """Purpose of a message: priority, congestion control, and whether it is sent without batching."""

    CONTROL = (Priority.INTERACTIVE_HIGH, CongestionControl.BLOCK, True)
    POSE = (Priority.DATA_HIGH, CongestionControl.DROP, True)
    STREAM = (Priority.DATA, CongestionControl.DROP, False)
    PRODUCT = (Priority.DATA_LOW, CongestionControl.BLOCK, False)
