# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""All disturbances, in two lanes that run at the same time: faults of the mission, and strangers."""

from __future__ import annotations

from tests.chaos.disturbances import clock_jumps, full_disks, http_clients, intruders, junk
from tests.chaos.disturbances.disturbance import Disturbance
from tests.chaos.disturbances.processes import FailureBudget, stop_briefly
from tests.chaos.mission import Mission


def faults() -> tuple[Disturbance, ...]:
    """Return the faults of processes, disks and clocks."""
    budget = FailureBudget()
    return (
        Disturbance("kill", budget.kill, 15.0),
        Disturbance("stop", stop_briefly, 20.0),
        Disturbance("hang", budget.hang, 45.0),
        Disturbance("crash loop", budget.crash_repeatedly, 150.0),
        Disturbance("full disk of the store", full_disks.fill_store, 20.0, _has_disks),
        Disturbance("full disk of the outboxes", full_disks.fill_spool, 20.0, _has_disks),
        Disturbance("late clock of the DPM", clock_jumps.set_back_dpm, 20.0, _has_clocks),
        Disturbance("clock jump", clock_jumps.jump_any, 20.0, _has_clocks),
    )


def strangers() -> tuple[Disturbance, ...]:
    """Return the disturbances from outside."""
    return (
        Disturbance("intruder at the router", intruders.connect_to_router, 15.0),
        Disturbance("intruder with a certificate", intruders.use_keys_of_another_robot, 15.0),
        Disturbance("intruder at HTTP", intruders.write_over_http, 15.0),
        Disturbance("junk messages", junk.send_junk, 10.0),
        Disturbance("junk calls", junk.call_with_junk, 20.0),
        Disturbance("idle sockets", http_clients.hold_idle_sockets, 15.0),
        Disturbance("slow readers", http_clients.read_slowly, 15.0),
        Disturbance("HTTP junk", http_clients.send_junk, 15.0),
    )


def _has_disks(mission: Mission) -> bool:
    return mission.disks.is_mounted


def _has_clocks(mission: Mission) -> bool:
    return mission.clocks.is_built
