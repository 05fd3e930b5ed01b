# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarms about products that are lost or can be lost before the DPM has them."""

from __future__ import annotations

from services.alarms import Alarms, Severity
from services.dfpc_host.outbox import Outbox

_FREE = "free space on the disk of this host"


def set_outbox_alarms(alarms: Alarms, source: str, outbox: Outbox) -> None:
    """Begin and end the alarms of an outbox; losses stay until the process ends."""
    spool = outbox.spool
    if spool.in_memory:
        problem = f"{spool.in_memory} products are only in memory, the disk takes no files"
        alarms.set("outbox_in_memory", source, Severity.CRITICAL, problem, _FREE)
    else:
        alarms.clear("outbox_in_memory", source)
    count_by_reason = {
        "were only in memory when the last process ended": spool.lost,
        "were dropped because the outbox was full": spool.dropped,
        "were refused by the DPM": outbox.refused,
    }
    reasons = [f"{count} products {reason}" for reason, count in count_by_reason.items() if count]
    if reasons:
        remedy = "make the products again from the log of the robot, if they are needed"
        alarms.set("outbox_lost", source, Severity.CRITICAL, "; ".join(reasons), remedy)
