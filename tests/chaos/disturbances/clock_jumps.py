# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wall clocks of services that jump."""

from __future__ import annotations

import time

from tests.chaos.disturbances.disturbance import Scene

_REPORTED_S = 30.0
_DAY_S = 86400.0


def set_back_dpm(scene: Scene) -> None:
    """Let the clock of the DPM run late: products are in its future and wait in the outboxes."""
    mission = scene.mission
    with mission.clocks.jumped("services.dpm", -scene.rng.uniform(120.0, 1800.0)):
        scene.oracle.expect_alarm(
            "clock_skew", "mana", lambda: mission.has_alarm("clock_skew", "mana"), _REPORTED_S
        )


def jump_any(scene: Scene) -> None:
    """Let the clock of a service jump by up to a day forwards, or half an hour back, for a few seconds."""
    modules = ("services.router", "services.orchestrator", "services.icu", "services.dfpc_host")
    jump_s = scene.rng.choice((scene.rng.uniform(60.0, _DAY_S), -scene.rng.uniform(60.0, 1800.0)))
    with scene.mission.clocks.jumped(scene.rng.choice(modules), jump_s):
        time.sleep(scene.rng.uniform(3.0, 8.0))
