# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``dpm/@rpc/{alarms|acknowledge}``: active alarms of all services, and their acknowledgement."""

from __future__ import annotations

from cdff_common.bus import Reply, Request
from cdff_common.contract.parameters import Parameters
from cdff_common.contract.queries import AlarmParameters
from services.dpm.bus.calls import parse_call
from services.dpm.operations.dpm import Dpm


def alarms(dpm: Dpm, request: Request) -> Reply:
    """Return the active alarms of all services: ``{items}``."""
    parse_call(Parameters, request)
    return Reply.of({"items": dpm.alarm_board.active()})


def acknowledge(dpm: Dpm, request: Request) -> Reply:
    """Acknowledge the active alarm ``kind=`` of ``source=`` and return it."""
    p = parse_call(AlarmParameters, request)
    return Reply.of(dpm.acknowledge(p.kind, p.source))
