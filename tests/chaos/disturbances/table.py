# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""All disturbances, in two lanes that run at the same time: faults of the mission, and strangers."""

from __future__ import annotations

from tests.chaos.disturbances.disturbance import Disturbance
from tests.chaos.disturbances.processes import FailureBudget, stop_briefly


def faults() -> tuple[Disturbance, ...]:
    """Return the faults of processes, disks and clocks."""
    budget = FailureBudget()
    return (
        Disturbance("kill", budget.kill, 15.0),
        Disturbance("stop", stop_briefly, 20.0),
        Disturbance("hang", budget.hang, 45.0),
    )


def strangers() -> tuple[Disturbance, ...]:
    """Return the disturbances from outside."""
    return ()
