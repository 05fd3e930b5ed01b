# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Access to Zenoh: keys, sessions, publish/subscribe, remote calls, liveliness, mission clock. Only this
package imports zenoh.
"""

from cdff_common.bus.bus import Bus
from cdff_common.bus.message import Message, Reply, Request
from cdff_common.bus.pause import Pause, Signal, without_pauses
from cdff_common.bus.qos import Qos
from cdff_common.bus.subscription import Subscription

__all__ = [
    "Bus",
    "Message",
    "Pause",
    "Qos",
    "Reply",
    "Request",
    "Signal",
    "Subscription",
    "without_pauses",
]
