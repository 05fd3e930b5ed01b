# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Planning of a request while the state of the system changes."""

from __future__ import annotations

from pathlib import Path

from cdff_common.clock import ManualClock
from cdff_common.interfaces.profile import load_profile
from cdff_core.orchestration.request import parse_request
from cdff_core.orchestration.world import ProviderId
from services.orchestrator.planning import RequestPlanner
from services.orchestrator.state import SystemState

PROFILE = Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml"
MAPPING = ProviderId("mana", "digital_elevation_mapping")


class Finder:
    """Finder double without products; the process of ``MAPPING`` ends during the query of the coverage."""

    def __init__(self, state: SystemState) -> None:
        self.state = state

    def find(self, *_: object) -> tuple[None, str]:
        return None, "no product"

    def coverage(self, *_: object) -> None:
        self.state.set_alive(MAPPING, alive=False)


def test_a_plan_uses_the_state_after_the_query_of_the_coverage() -> None:
    state = SystemState(load_profile(PROFILE))
    for robot in state.profile.robots:
        for entry in robot.dfpcs:
            state.set_alive(ProviderId(robot.id, entry.name), alive=True)
    planner = RequestPlanner(state, Finder(state), ManualClock(0))  # type: ignore[arg-type]  # double
    request = parse_request({"type": "dem", "robot": "mana", "region": "circle:0,0,5"}, "mana")
    explanation = planner.explain(request).body()
    assert explanation["plan"]["waits_for"] == [str(MAPPING)]
    assert any(str(MAPPING) in reason for reason in explanation["why_not"])
